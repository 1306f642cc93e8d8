"""Quarter and half turns of a sensor, distinguished by the weight it reads."""

import numpy as np
import pytest

from ftbias_jax.calibration.tool.mounting import likely_rotation
from ftbias_jax.calibration.tool.static import weight_columns
from ftbias_jax.check.mounts import ROTATIONS

TURNS = np.stack(ROTATIONS)
STD = np.repeat([0.1, 0.004], 3)


def log_of(turn, seed=0, tumbling=True):
    """Columns for the axes as stated, the reading of a sensor whose axes are v_stated = turn v_true, and time."""
    rng = np.random.default_rng(seed)
    s = rng.normal(size=(300, 3))
    s = 9.81 * s / np.linalg.norm(s, axis=1, keepdims=True) if tumbling else np.tile([0.0, 0.0, 9.81], (300, 1))
    true = s @ turn
    moment = np.array([0.01, 0.02, 0.05])
    wrench = np.concatenate([0.8 * true, np.cross(moment, true)], 1) - [4, -3, 9, 0.1, 0.2, -0.3]
    t = np.linspace(0, 30, 300)
    wrench = wrench + 0.01 * t[:, None] * STD + STD * rng.normal(size=wrench.shape)
    wrench[::7, 3] = np.nan
    return weight_columns(s), wrench, t, STD


@pytest.mark.parametrize("turn", TURNS)
def test_each_of_them_is_recognised(turn):
    np.testing.assert_array_equal(likely_rotation(*log_of(turn)), turn)


def test_what_neither_motion_nor_a_whole_reading_shows_is_taken_as_stated():
    columns, wrench, t, std = log_of(TURNS[5])
    unmeasured = columns, np.full_like(wrench, np.nan), t, std
    for log in (log_of(TURNS[5], tumbling=False), unmeasured):
        np.testing.assert_array_equal(likely_rotation(*log), np.eye(3))
