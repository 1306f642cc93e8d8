import by_params
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.filtering.quality import observability
from ftbias_jax.filtering.result import ARRAYS, Filtered
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup import parse_setup

WRIST = {
    "robot": {
        "joints": [
            {"axis": [0, 1, 0], "point": [0, 0, 0], "name": "pitch"},
            {"axis": [1, 0, 0], "point": [0, 0, 0], "name": "roll"},
        ],
        "flange": {"translation": [0, 0, 0.1]},
    },
    "sensor": {"noise_std": 0.1},
    "tool": {"mass": 1.0, "center_of_mass": [0, 0, 0.1]},
}
COUNT = 200


def unobservable(pitch, roll, parts=1):
    q = np.broadcast_to(np.stack([np.broadcast_to(x, COUNT) for x in (pitch, roll)], 1), (COUNT, 2))
    fields = dict.fromkeys(ARRAYS, np.zeros((COUNT, 2)))
    filtered = Filtered(**{**fields, "t": np.arange(COUNT) * 0.1, "q": q})
    turning, params = observability.start(), params_from_setup(parse_setup(WRIST), jnp.float64)
    for rows in np.array_split(np.arange(COUNT), parts):
        turning = observability.add(turning, params, by_params.part_of(filtered, rows))
    return observability.unobservable(turning)


SWING = 0.5 * np.sin(np.arange(COUNT) * 0.1)


@pytest.mark.parametrize("parts", [1, 3, 300])
def test_a_pose_that_does_not_change_hides_the_weight(parts):
    assert unobservable(0.3, -0.2, parts) == ["mass", "center_of_mass"]


def test_turning_about_one_axis_hides_the_centre_of_mass_where_gravity_moves():
    """Small turns about y move gravity along x, so a torque m c x g hardly says where c is along x."""
    assert unobservable(0.2 * SWING, 0.0) == ["center_of_mass along (1.00, 0.00, 0.00)"]
    assert unobservable(0.0, 0.2 * SWING) == ["center_of_mass along (0.00, 1.00, 0.00)"]


def test_turning_about_two_axes_hides_nothing():
    assert unobservable(SWING, SWING[::-1]) == []


def test_turning_about_gravity_hides_everything():
    down = {"axis": [0, 0, 1], "point": [0, 0, 0], "name": "yaw"}
    setup = parse_setup({**WRIST, "robot": {**WRIST["robot"], "joints": [down]}})
    fields = dict.fromkeys(ARRAYS, np.zeros((COUNT, 1)))
    part = Filtered(**{**fields, "t": np.arange(COUNT) * 0.1, "q": SWING[:, None]})
    turning = observability.add(observability.start(), params_from_setup(setup, jnp.float64), part)
    assert observability.unobservable(turning) == ["mass", "center_of_mass"]
