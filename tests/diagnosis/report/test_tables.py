import json
import math

import numpy as np
import pytest

from ftbias_jax.diagnosis.report.as_json import to_json
from ftbias_jax.diagnosis.report.tables import parameter_words, to_table, value_words


def test_the_json_has_the_keys_of_the_format(make_diagnosis):
    content = to_json(make_diagnosis())
    assert content["schema"] == 2
    assert content["verdict"] == "explained"
    assert (
        content["causes"][0].items()
        >= {
            "effect": "tool_mass",
            "stage": "tool",
            "indistinguishable_from": ["gain"],
            "parameters": {"mass": 0.8134},
            "stderr": {"mass": 0.0041},
            "held_out_gain": 1.93,
            "held_out_gain_stderr": 0.11,
            "shrink": 0.97,
        }.items()
    )
    assert content["gap"]["before"]["in_noise_sigmas"] == 3.4
    assert len(content["gap"]["after"]["rms"]) == 6
    assert content["gap"].keys() == {"before", "after", "shrink", "shrink_stderr", "noise_floor"}
    assert content["where"].keys() >= {"stages", "channels", "intervals", "regimes"}
    assert content["where"]["intervals"] == [[12.0, 13.4, 5.2]]
    assert content["where"]["regimes"] == [{"name": "fast motion", "share": 0.7, "expected": 0.33}]
    assert [candidate["effect"] for candidate in content["candidates"]] == ["tool_mass", "gain"]
    assert content["candidates"][0].keys() == content["causes"][0].keys()


def test_the_json_has_the_errors_that_apply_writes(make_diagnosis):
    assert to_json(make_diagnosis()).items() >= {"tool_stderr": {}, "model_stderr": None}.items()
    errors = {"mass": np.float64(0.01), "center_of_mass": np.full(3, 1e-3)}
    content = to_json(make_diagnosis(tool_stderr=errors, model_stderr=np.full(6, 0.2)))
    assert content["tool_stderr"] == {"mass": 0.01, "center_of_mass": [1e-3] * 3}
    assert content["model_stderr"] == [0.2] * 6


def test_the_json_is_strict_whatever_the_numbers(make_diagnosis, make_candidate):
    odd = make_candidate(
        parameters={"mass": np.float64(1.0), "gain": np.array([np.inf, 1.0]), "count": np.int64(2)},
        stderr={"mass": float("nan"), "gain": [None, 1.0]},
        held_out_gain=np.float32("nan"),
    )
    read = json.loads(json.dumps(to_json(make_diagnosis(causes=(odd,))), allow_nan=False))
    cause = read["causes"][0]
    assert cause["parameters"] == {"mass": 1.0, "gain": [None, 1.0], "count": 2}
    assert cause["stderr"] == {"mass": None, "gain": [None, 1.0]}
    assert cause["held_out_gain"] is None


def test_the_table_says_the_verdict_first_and_then_everything(make_diagnosis):
    lines = to_table(make_diagnosis()).splitlines()
    assert lines[0] == "explained: The tool weighs 0.81 kg."
    text = "\n".join(lines)
    for words in (
        "mass = 0.8134 ± 0.0041 kg",
        "1.93 ± 0.11 nats/s",
        "or gain: to tell them apart: turn the wrist",
        "what to do: weigh the tool",
        "shrinks by 98 ± 1 %",
        "fast motion: 70 % of the gap in 33 % of the time",
        "12.0 to 13.4 s (5.2 sigmas)",
        "not tested: temperature_drift (no temperature was recorded)",
    ):
        assert words in text
    assert max(map(len, lines)) <= 110


def test_the_table_of_no_gap_claims_no_place(make_diagnosis):
    text = to_table(make_diagnosis(verdict="none", sentence="All is well.", causes=()))
    assert text.startswith("no gap: All is well.")
    assert "fast motion" not in text
    assert "cause" not in text


def test_no_text_moves_the_cursor(make_diagnosis, make_candidate):
    evil = "\x1b[2J\nverdict: \udcff"
    cause = make_candidate(remedy=evil, indistinguishable_from=(evil,))
    text = to_table(make_diagnosis(sentence=evil, causes=(cause,), not_tested=((evil, evil),)))
    assert "\x1b" not in text
    assert "\nverdict" not in text
    text.encode()


@pytest.mark.parametrize(
    ("value", "stderr", "words"),
    [
        (0.81342, 0.00412, "0.8134 ± 0.0041"),
        (-12.3456, 1.234, "-12.3 ± 1.2"),
        (1234.5, 67.8, "1234 ± 68"),
        (3.0e-9, 2.5e-10, "3.00e-09 ± 2.5e-10"),
        (0.0, 2.5e-8, "0.0e+00 ± 2.5e-08"),
        (12345.0, 678.0, "12345 ± 678"),
        (0.5, math.nan, "0.5"),
        (0.5, 0.0, "0.5"),
        (math.inf, 1.0, "inf"),
    ],
)
def test_a_number_has_the_digits_that_its_error_allows(value, stderr, words):
    assert value_words(value, stderr) == words


def test_long_lists_are_shortened_and_unknown_effects_have_no_unit(make_candidate):
    matrix = np.zeros((6, 6))
    matrix[1, 3] = -0.031
    long = make_candidate("unheard_of", parameters={"matrix": matrix.tolist(), "x": 2.0}, stderr={"matrix": 1.0})
    assert parameter_words(long) == [("matrix", "-0.031 at (2, 4): the surest of 36"), ("x", "2")]
