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
YAW = {"axis": [0, 0, 1], "point": [0, 0, 0], "name": "yaw"}
SWING = 0.5 * np.sin(np.arange(COUNT) * 0.1)
STILL = np.full(COUNT, 0.3)
EVERYTHING = ["mass", "center_of_mass"]


@pytest.mark.parametrize("parts", [1, 3, 300])
@pytest.mark.parametrize(
    ("joints", "q", "hidden"),
    [
        pytest.param(None, (STILL, -STILL), EVERYTHING, id="a pose that does not change hides the weight"),
        # Small turns about y move gravity along x, so a torque m c x g hardly determines c along x.
        pytest.param(None, (0.2 * SWING, 0 * STILL), ["center_of_mass along (1.00, 0.00, 0.00)"], id="turns about y"),
        pytest.param(None, (0 * STILL, 0.2 * SWING), ["center_of_mass along (0.00, 1.00, 0.00)"], id="turns about x"),
        pytest.param(None, (SWING, SWING[::-1]), [], id="turning about two axes hides nothing"),
        pytest.param([YAW], (SWING,), EVERYTHING, id="turning about gravity hides everything"),
    ],
)
def test_what_the_poses_of_a_log_hide_of_the_tool(joints, q, hidden, parts):
    setup = WRIST if joints is None else {**WRIST, "robot": {**WRIST["robot"], "joints": joints}}
    fields = dict.fromkeys(ARRAYS, np.zeros((COUNT, len(q))))
    filtered = Filtered(**{**fields, "t": np.arange(COUNT) * 0.1, "q": np.stack(q, 1)})
    turning, params = observability.start(), params_from_setup(parse_setup(setup), jnp.float64)
    for rows in np.array_split(np.arange(COUNT), parts):
        turning = observability.add(turning, params, by_params.part_of(filtered, rows))
    assert observability.unobservable(turning) == hidden
