"""Contact (pushes, a tool resting on a table) is not mistaken for a wrong setup; a sensor set to zero still is one."""

import numpy as np
import pytest
from small_checks import checked, log_with_rests, right_log

REST = (12.0, 25.0)


def names(check):
    return [finding.mistake for finding in check.findings]


def window(t, start, end, ramp):
    """1 from start to end, 0 outside, with ramps of ``ramp`` seconds."""
    return np.clip(np.minimum((t - start) / ramp, (end - t) / ramp), 0, 1)[:, None]


def pushed(seed, share, strength):
    """A person pushes along -x of the base for a share of the log, at a point of the tool."""
    tables, arrays, _, motion = log_with_rests(seed, [])
    rng = np.random.default_rng(seed)
    start = rng.uniform(0, 40 * (1 - share))
    size = window(arrays["t"], start, start + 40 * share, 0.3) * strength
    force = np.einsum("nji,nj->ni", motion.rotation, size * [-1.0, 0, 0])
    torque = np.cross(rng.uniform(-0.1, 0.1, 3), force)
    arrays["wrench"] = arrays["wrench"] + np.concatenate([force, torque], 1)
    return tables, arrays


PUSHES = [(1, 0.65, 20), (1, 0.6, 40), (2, 0.4, 40), (4, 0.5, 40), (5, 0.4, 40)]


@pytest.mark.parametrize(("seed", "share", "strength"), PUSHES)
def test_a_person_who_pushes_the_arm_is_no_mistake_of_the_setup(seed, share, strength):
    found = checked(*pushed(seed, share, strength))
    assert found.ok, str(found)


@pytest.mark.parametrize("gravity", [[9.81, 0.0, 0.0], [0.0, 0.0, 9.81]])
def test_gravity_that_is_stated_wrong_is_named_though_the_arm_is_pushed(gravity):
    tables, arrays = pushed(1, 0.4, 20.0)
    tables["robot"]["gravity"] = gravity
    assert names(checked(tables, arrays)) == ["gravity"]


def resting(seed, start, end, ramp):
    """A table carries the tool from start to end, in the pose in which the sensor was set to zero before.

    The tool touches down as the arm slows down, and leaves the table as the arm sets off.
    """
    tables, arrays, tool, _ = log_with_rests(seed, [(start, end)])
    t = arrays["t"]
    there = tool[np.argmin(np.abs(t - np.clip((start + end) / 2, 0, 40)))]
    free = tool - there + arrays["wrench"] - tool  # without the bias
    free -= free.mean(0) - (tool - there).mean(0)
    press = np.array([1.0, -2.0, 25.0, 0.5, 0.2, 0.1])
    arrays["wrench"] = free + window(t, start - 0.25, end + 0.25, ramp) * press
    return tables, arrays


@pytest.mark.parametrize("ramp", [0.01, 0.2])
@pytest.mark.parametrize(("start", "end"), [(-9.0, 12.0), REST], ids=["from the start", "in between"])
def test_a_tool_that_leaves_a_table_has_not_been_set_to_zero(start, end, ramp):
    for seed in range(3):
        found = checked(*resting(seed, start, end, ramp))
        assert "rezeroed" not in {m.mistake for m in found.findings if not m.harmless}, str(found)


@pytest.mark.parametrize("ramp", [0.02, 0.3, 2.0])
def test_an_external_wrench_that_returns_to_zero_is_no_tare(ramp):
    for seed in range(3):
        tables, arrays, _, _ = log_with_rests(seed, [])
        row = 2400  # the reading is zero when the contact ends, as it was for a moment before it began
        arrays["wrench"] = arrays["wrench"] - arrays["wrench"][row]
        extra = window(arrays["t"], 10.0, 24.0, ramp) * [20.0, -10, 15, 0.5, 0.3, -0.2]
        arrays["wrench"] = arrays["wrench"] + extra
        found = checked(tables, arrays)
        assert not [m for m in found.findings if not m.harmless], str(found)


@pytest.mark.parametrize("rests", [[], [REST]], ids=["as it moves", "at rest"])
@pytest.mark.parametrize("touched", [False, True])
def test_a_sensor_that_is_set_to_zero_is_told_from_contact(rests, touched):
    for seed in range(3):
        tables, arrays, _, _ = log_with_rests(seed, rests)
        if touched:
            arrays["wrench"] = arrays["wrench"] + window(arrays["t"], 29.0, 36.0, 0.2) * [20.0, -10, 15, 0.5, 0.3, -0.2]
        arrays["wrench"][1600:] -= arrays["wrench"][1600]
        found = checked(tables, arrays)
        assert names(found) == ["rezeroed"], str(found)
        assert found.findings[0].evidence["times"] == pytest.approx([16.0], abs=0.1)


@pytest.mark.parametrize("force", [0.0, 60.0])
def test_a_tool_that_stands_on_a_table_as_the_log_begins_is_no_offset(force):
    """Without bias, a table that carries the tool makes the sensor read zero; one that pushes gives a large reading."""
    tables, arrays, tool, _ = log_with_rests(2, [(-9.0, 6.0)])
    on = window(arrays["t"], -9.0, 6.25, 0.2)
    free = arrays["wrench"] - np.mean(arrays["wrench"] - tool, axis=0)
    arrays["wrench"] = free + on * (-tool[0] if force == 0 else np.array([0, 0, force, 0, 0, 0]))
    found = checked(tables, arrays)
    assert found.ok, str(found)


def test_a_centre_of_mass_that_is_stated_too_near_is_no_unit_of_the_torque():
    for center in (0.01, 0.02):
        tables, arrays = right_log(seed=1)
        tables["tool"].update(mass=0.5, center_of_mass=[0.0, 0.0, center])
        assert "wrench_units" not in names(checked(tables, arrays))
