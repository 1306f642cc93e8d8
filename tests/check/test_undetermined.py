"""What a log cannot show is reported as undetermined, instead of as correct."""

import json

import numpy as np
import pytest
from small_checks import checked, right_log

import ftbias_jax as ft
from ftbias_jax.check.result import MISTAKES
from ftbias_jax.check.undetermined import OF_ARM, OF_POSE


def unseen(tables, arrays):
    return {kind.mistake for kind in checked(tables, arrays).undetermined}


def held_at(arrays, row):
    """The same arm held in one pose, with noise."""
    still = np.random.default_rng(0).normal(size=arrays["wrench"].shape) * np.repeat([0.1, 0.004], 3)
    wrench = arrays["wrench"][row] + still
    return {**arrays, "q": np.tile(arrays["q"][row], (len(still), 1)), "dq": 0 * arrays["dq"], "wrench": wrench}


def test_a_log_that_moves_leaves_nothing_open():
    for seed in range(3):
        assert unseen(*right_log(seed=seed)) == set()


def test_at_rest_nearly_everything_is_open():
    tables, arrays = right_log(seed=6)
    found = checked(tables, held_at(arrays, 100))
    assert found.ok
    seen = set(OF_ARM) - {kind.mistake for kind in found.undetermined}
    # Angles in degrees, an offset, and a reading set to zero also show at rest.
    assert seen == {"angle_units", "raw_offset", "rezeroed"}
    assert all(kind.remedy for kind in found.undetermined)


def test_what_is_open_is_written_and_printed_with_what_would_show_it(tmp_path):
    tables, arrays = right_log(seed=6)
    found = checked(tables, held_at(arrays, 100))
    found.to_json(tmp_path / "check.json")
    content = json.loads((tmp_path / "check.json").read_text())
    assert content["ok"] is True
    assert {"mistake", "remedy"} == set(content["undetermined"][0])
    assert {kind["mistake"] for kind in content["undetermined"]} < set(MISTAKES)
    (first, *_) = str(found).splitlines()[1:]
    assert first.startswith("not shown by these logs: sign, gravity, wrench_units, tool_units, ")
    assert "turn the sensor by 30 degrees or more" in first


def test_a_turn_about_the_vertical_shows_no_more_than_rest():
    """The weight is constant in the sensor's frame; only a slow joint moves."""
    tables, arrays = right_log(seed=6)
    q = np.tile(arrays["q"][:1], (len(arrays["t"]), 1))
    q[:, 0] = 0.5 * np.sin(0.3 * arrays["t"])
    rng = np.random.default_rng(1)
    wrench = arrays["wrench"][:1] + rng.normal(size=arrays["wrench"].shape) * np.repeat([0.1, 0.004], 3)
    turned = {**arrays, "q": q, "dq": np.gradient(q, arrays["t"], axis=0), "wrench": wrench}
    assert unseen(tables, turned) >= {"sign", "gravity", "wrench_units", "sensor_axes", "compensated"}


def test_a_mistake_that_is_called_open_is_not_found_when_it_is_made():
    tables, arrays = right_log(seed=6)
    setup = ft.parse_setup(tables)
    assert "time_offset" not in unseen(tables, arrays)
    slow = {**arrays, "t": 50 * arrays["t"], "dq": arrays["dq"] / 50}  # so slow that half a second does not matter
    found = checked(tables, slow)
    assert "time_offset" in {kind.mistake for kind in found.undetermined}
    late = {**slow, "wrench": np.roll(slow["wrench"], round(0.5 * 2), 0)}
    assert ft.check_setup(setup, [ft.Log.from_arrays(setup, **late)]).ok


def test_touches_that_drown_the_tool_leave_its_signs_open():
    tables, arrays = right_log(seed=3)
    rng = np.random.default_rng(0)
    at = np.arange(0, 40, 0.3)
    force = np.stack([np.interp(arrays["t"], at, rng.normal(0, 60, len(at))) for _ in range(6)], 1)
    arrays["wrench"] = arrays["wrench"] + force * np.repeat([1, 0.05], 3)
    assert unseen(tables, arrays) >= {"sign", "gravity", "sensor_axes"}


def test_units_need_a_tool_that_is_stated():
    tables, arrays = right_log(seed=3)
    del tables["tool"]
    assert unseen(tables, arrays) >= {"wrench_units", "tool_units"}
    assert "sign" not in unseen(tables, arrays)


def test_missing_axes_and_compensated_readings_say_what_to_record():
    tables, arrays = right_log(seed=3)
    arrays["wrench"][:, 4] = np.nan
    kinds = {kind.mistake: kind.remedy for kind in checked(tables, arrays).undetermined}
    assert kinds.keys() == {"force_torque_swapped", "sensor_axes", "base_frame_wrench"}
    assert set(kinds.values()) == {"record all six axes of the wrench"}
    tables["sensor"]["compensated"] = True
    kinds = {kind.mistake: kind.remedy for kind in checked(tables, arrays).undetermined}
    assert kinds.keys() == set(OF_ARM) - {"raw_offset", "rezeroed", "compensated"}


def test_a_short_log_shows_nothing():
    tables, arrays = right_log(duration=1.0)
    found = checked(tables, arrays)
    assert {kind.mistake for kind in found.undetermined} == set(OF_ARM)
    assert {kind.remedy for kind in found.undetermined} == {"record motion and wrench together for at least 5 s"}


@pytest.mark.parametrize("kinds", [OF_ARM + OF_POSE])
def test_every_kind_is_one_of_the_list(kinds):
    assert set(kinds) == set(MISTAKES)
