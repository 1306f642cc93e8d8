"""Made-up diagnoses of withheld kinds against their labels, and the resulting tables."""

import json

import numpy as np
import pytest

from ftbias_jax.errors import LogError
from validation import protocols, runs
from validation.description_tables import content, judged, text
from validation.descriptions import judge
from validation.labels import Withheld


def term(drive, *equivalent, **values):
    return {"drive": drive, "equivalent_to": list(equivalent), "coefficients": {}, "stderr": {}, **values}


@pytest.fixture
def hose(make_label):
    """The label of a hose with a gap of ``sigmas`` noise standard deviations."""

    def make(gap_sigmas=2.0, **changes):
        twins, numbers = ("joint_velocity",), {"N_per_m_s": 5.0}
        truth = Withheld("hose", "viscous", "velocity", twins, ("cable",), "base", "force", numbers, 1.0, False)
        return make_label({"hose": {}}, gap_sigmas)._replace(withheld=truth._replace(**changes))

    return make


@pytest.mark.parametrize(
    ("terms", "right", "equivalent", "claimed", "anywhere"),
    [
        ([term("velocity")], True, True, True, True),
        ([term("joint_velocity")], False, True, True, False),
        ([term("load", "velocity")], False, False, True, False),
        ([term("load", "a", "b", "joint_velocity")], False, False, True, False),
        ([term("load", "a", "b", "c", "velocity")], False, False, False, False),  # more than three are no answer
        ([term("load"), term("velocity")], False, False, False, True),
        ([], False, False, False, False),
        (None, False, False, False, False),  # schema 1
    ],
)
def test_which_drives_count(hose, make_said, terms, right, equivalent, claimed, anywhere):
    said = make_said("described") | ({} if terms is None else {"terms": terms})
    found = judge(hose(), said)
    assert (found.right, found.equivalent, found.claimed, found.anywhere) == (right, equivalent, claimed, anywhere)


def test_catalogue_names_are_wrong_unless_the_label_calls_them_nearly_the_same(hose, make_said):
    found = judge(hose(), make_said("partly_explained", "gain", ("contact", "cable"), "cable", "crosstalk"))
    assert found.wrong == ("gain", "crosstalk")
    assert found.nearly == ("contact", "cable")


def test_coefficients_are_compared_where_drive_unit_and_shape_are_the_same(hose, make_said):
    def numbers(*terms, **truth):
        return judge(hose(**truth), make_said("described") | {"terms": list(terms)}).coefficients

    near = term("velocity", coefficients={"N_per_m_s": 5.2, "kg": 1.0}, stderr={"N_per_m_s": 0.1, "kg": 0.1})
    (found,) = numbers(near)
    assert found.unit == "N_per_m_s"
    np.testing.assert_allclose(found.error / found.stderr, [2.0])
    assert found.inside.tolist() == [True]
    assert numbers(near | {"stderr": {"N_per_m_s": 0.05}})[0].inside.tolist() == [False]
    assert numbers(near | {"drive": "joint_velocity"}) == ()
    assert numbers(near | {"stderr": {}}) == ()
    assert numbers(near, coefficients={"N_per_m_s": [5.0, 5.0, 5.0]}) == ()
    line = near | {"parameters": {"frequency": 50.2}, "parameters_stderr": {"frequency": 0.1}}
    assert [x.unit for x in numbers(line, coefficients={"frequency": 50.0})] == ["frequency"]
    vector = term("velocity", coefficients={"N": [1.0, 2.0, 4.0]}, stderr={"N": [0.1, 0.1, 0.1]})
    assert numbers(vector, coefficients={"N": [1.0, 2.0, 3.0]})[0].inside.tolist() == [True, True, False]


def test_a_label_of_a_listed_effect_is_not_judged(make_label, make_said):
    with pytest.raises(ValueError, match="no withheld kind"):
        judge(make_label({"gain": {}}), make_said("none"))
    assert judged({"log_000": (make_label({"gain": {}}), make_said("none"))}) == {}


@pytest.fixture
def scored(hose, make_said):
    """Five logs: right, equivalent, misnamed, faint, and noise without a mean gap."""
    good = term("velocity", coefficients={"N_per_m_s": 5.1}, stderr={"N_per_m_s": 0.1})
    bridge = {"kind": "rough_bridge", "form": "force", "drive": "noise", "oracle_shrink": None, "coefficients": {}}
    return {
        "log_000": (hose(4.0), make_said("described", shrink=0.95) | {"terms": [good], "second": {"shrink": 0.9}}),
        "log_001": (
            hose(0.7),
            make_said("described", shrink=0.75) | {"terms": [term("joint_velocity")], "second": {"shrink": 0.3}},
        ),
        "log_002": (hose(2.0), make_said("explained", "gain", shrink=0.5)),
        "log_003": (hose(0.4), make_said("none", shrink=0.0)),
        "log_004": (hose(1.0, **bridge), make_said("described", shrink=0.0) | {"terms": [term("noise")]}),
    }


def test_the_score_counts_what_is_not_too_faint(scored):
    found = content(judged(scored))
    counted = found["counted"]
    assert counted["logs"] == 4
    assert {name: (row["hits"], row["of"]) for name, row in counted["score"].items()} == {
        "right drive first": (2, 4),
        "right or equivalent by physics": (3, 4),
        "right or declared equivalent": (3, 4),
        "right drive among the terms": (2, 4),
        "wrong catalogue name among the causes": (1, 4),
        "catalogue name of nearly the same": (0, 4),
        "confidently misnamed (explained)": (1, 4),
        "described": (3, 4),
        "no gap seen": (0, 4),
        "coefficients: truth within 3 sigma": (1, 1),
    }
    assert counted["verdicts"] == {"described": 3, "explained": 1}
    assert counted["medians"]["shrink"] == pytest.approx(0.75)  # of those with a mean gap
    assert counted["medians"]["lost_on_second_log"] == pytest.approx((0.05 + 0.45) / 2)
    assert (counted["shrink_holds_on_second_log"]["hits"], counted["shrink_holds_on_second_log"]["of"]) == (1, 2)
    assert [(row["from_sigmas"], row["logs"]) for row in found["by_size"]] == [(0, 1), (0.5, 1), (1, 2), (3, 1)]
    assert found["by_kind"]["hose, viscous"]["logs"] == 4
    assert found["rows"][0]["errors_in_stderr"]["N_per_m_s"] == pytest.approx([1.0])
    json.dumps(found, allow_nan=False)
    said = text(judged(scored))
    assert "right drive first                                  2/4   50%" in said
    assert "verdicts: described 3, explained 1" in said
    assert text({}).startswith("withheld kinds: 0 of 0 logs")


def withheld_set(make_set, name="hose"):
    """A set of one pair, with its label."""
    folder = make_set({"log_000": {name: {}}})
    (folder / "second").mkdir()
    np.savez(folder / "second" / "log_000.npz")
    truth = json.loads((folder / "truth.json").read_text())
    truth["log_000"] |= {
        "form": {name: "viscous"},
        "term": {
            "drive": "velocity",
            "equivalent": [],
            "catalogue_twins": [],
            "frame": "base",
            "acts_as": "force",
            "coefficients": {},
            "unseen": False,
            "oracle_shrink": 1.0,
        },
    }
    (folder / "truth.json").write_text(json.dumps(truth))
    return folder


class Mended(dict):
    """A diagnosis in its JSON form that can be applied."""

    def apply(self, setup):
        return f"mended {setup}"


@pytest.fixture
def answered(monkeypatch, make_said):
    said = Mended(make_said("described", shrink=0.9) | {"schema": 2, "terms": [term("velocity")]})
    monkeypatch.setattr(runs, "diagnose", lambda setup, logs, names, without: said)
    monkeypatch.setattr(runs, "to_json", dict)
    monkeypatch.setattr(runs, "load_setup", lambda path: path.name)
    monkeypatch.setattr(runs, "read_log", lambda path, setup, raw: path.parent.name)


def test_what_was_found_is_applied_to_the_second_log(make_set, answered, monkeypatch):
    asked = []
    monkeypatch.setattr(runs, "shrink_of", lambda *told: asked.append(told) or 0.8)
    folder = withheld_set(make_set)
    score = protocols.withheld(folder, runs.find_logs(folder), folder / "verdicts", 1)
    assert asked == [(folder / "second" / "log_000.npz", "log_000.toml", "mended log_000.toml")]
    assert score.content["unlisted_kinds"]["counted"]["medians"]["second_log"] == 0.8
    assert score.content["unlisted_kinds"]["counted"]["score"]["right drive first"]["hits"] == 1
    assert score.text.startswith("withheld kinds: 1 of 1 logs")


def test_a_verdict_whose_terms_have_no_drive_is_refused(make_set, answered):
    folder = withheld_set(make_set)
    (folder / "verdicts").mkdir()
    (folder / "verdicts" / "log_000.json").write_text('{"verdict": "described", "causes": [], "terms": [{}]}')
    with pytest.raises(LogError, match=r"log_000\.json: is no diagnosis"):
        protocols.withheld(folder, runs.find_logs(folder), folder / "verdicts", 1)
