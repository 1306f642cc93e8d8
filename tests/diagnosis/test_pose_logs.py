"""The diagnosis of logs that have the sensor's pose instead of joints: the right cause, and what was not tested."""

import numpy as np
import pytest
from stated import pose_setup

import ftbias_jax as ft

EFFECTS = {
    "none": {},
    "tool_mass": {"tool_mass": {"mass": 0.75}},
    "gain": {"gain": {"gain": [1.08, 1.0, 1.0, 1.0, 1.0, 1.0]}},
    "time_delay": {"time_delay": {"delay": 0.1}},
    "mount_rotation": {"mount_rotation": {"rotation": [0.03, -0.02, 0.04]}},
    "vibration": {"vibration": {"variance": [0.3] * 3 + [0.0005] * 3}},
    "warmup": {"warmup": {"amplitude": [3.0, -2.0, 2.0, 0.1, 0.1, 0.1], "tau": 6.0}},
}


@pytest.fixture(scope="module")
def setup():
    return pose_setup()


@pytest.mark.parametrize("name", EFFECTS)
def test_the_cause_of_a_pose_log_is_named(setup, name):
    made = ft.simulate(setup, EFFECTS[name], duration=30, rate=200, seed=1)
    diagnosis = ft.diagnose(setup, [made.log])
    untested = dict(diagnosis.not_tested)
    assert {"encoder_offset", "cable"} <= untested.keys()
    assert "joints of an arm" in untested["encoder_offset"]
    if name == "none":
        assert diagnosis.verdict == "none"
        return
    assert diagnosis.verdict == "explained"
    assert diagnosis.causes[0].effect == name
    assert len(diagnosis.causes) == 1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["none", "gain"])
def test_without_positions_turning_alone_shows_the_cause(name):
    """The sensor's unrecorded accelerations count as noise that averaging does not reduce."""
    setup = pose_setup(linear="none")
    made = ft.simulate(setup, EFFECTS[name], duration=30, rate=200, seed=1)
    diagnosis = ft.diagnose(setup, [made.log])
    assert [cause.effect for cause in diagnosis.causes] == ([] if name == "none" else ["gain"])
    assert dict(diagnosis.not_tested)["tool_flexibility"] == "the sensor's acceleration is not recorded"


@pytest.mark.slow
@pytest.mark.parametrize("force", [1.5, 8.0])
def test_without_positions_contact_is_what_accelerations_cannot_be(force):
    """The stated 0.3 m/s^2 cause 0.21 N on the tool; ten times that may be an arm that stops and goes."""
    setup = pose_setup(linear="none")
    log = ft.simulate(setup, duration=30, rate=200, seed=1).log
    wrench = np.array(log.wrench)
    for start, axis in zip((5, 11, 17, 23), (0, 1, 2, 0), strict=True):
        wrench[(log.t > start) & (log.t < start + 0.6), axis] += force * (1 if start < 20 else -1)
    diagnosis = ft.diagnose(setup, [log._replace(wrench=wrench)])
    assert ("contact" in [cause.effect for cause in diagnosis.causes]) == (force > 10 * 0.21)


@pytest.mark.slow
def test_the_mended_setup_filters_the_log(setup, tmp_path):
    made = ft.simulate(setup, EFFECTS["mount_rotation"], duration=30, rate=200, seed=1)
    diagnosis = ft.diagnose(setup, [made.log])
    diagnosis.to_html(tmp_path / "report.html")
    assert "mount_rotation" in (tmp_path / "report.html").read_text(encoding="utf-8")
    errors = [
        np.sqrt(np.square(ft.filter_log(s, made.log).bias - made.truth.bias).mean())
        for s in (setup, diagnosis.apply(setup))
    ]
    assert errors[1] < 0.5 * errors[0]
