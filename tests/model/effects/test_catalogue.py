import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ftbias_jax.errors import SetupError, UsageError
from ftbias_jax.model.effects.catalogue import CATALOGUE, check_values, complete, values_from_setup


def test_misspelt_names_are_answered_with_the_nearest():
    with pytest.raises(SetupError, match=r"effects\.tool_mas: unknown effect .*did you mean 'tool_mass'"):
        values_from_setup({"tool_mas": {"mass": 1.0}})
    with pytest.raises(SetupError, match=r"effects\.tool_mass\.masses: unknown key .*did you mean 'mass'"):
        values_from_setup({"tool_mass": {"masses": 1.0}})


def test_six_channels_may_be_one_number_or_force_and_torque():
    checked = values_from_setup({"gain": {"gain": 1.02}, "hysteresis": {"width": [0.2, 0.01]}})
    np.testing.assert_array_equal(checked["gain"]["gain"], np.full(6, 1.02))
    np.testing.assert_array_equal(checked["hysteresis"]["width"], [0.2] * 3 + [0.01] * 3)


def test_events_may_be_nested_or_flat_and_must_be_complete():
    nested = {"start": [1, 3], "end": [2, 4], "force": [[1, 2, 3], [4, 5, 6]]}
    flat = nested | {"force": [1, 2, 3, 4, 5, 6]}
    for raw in (nested, flat):
        np.testing.assert_array_equal(values_from_setup({"contact": raw})["contact"]["force"], nested["force"])
    with pytest.raises(SetupError, match="different numbers of events"):
        values_from_setup({"contact": nested | {"start": [1]}})
    with pytest.raises(SetupError, match="ends before it starts"):
        values_from_setup({"contact": nested | {"end": [2, 2.5]}})
    with pytest.raises(SetupError, match="without a direction"):
        values_from_setup({"gravity_tilt": {"gravity": [0, 0, 0]}})


def test_the_diagonal_of_crosstalk_belongs_to_gain():
    with pytest.raises(SetupError, match="crosstalk"):
        values_from_setup({"crosstalk": {"matrix": (1.01 * np.eye(6)).tolist()}})


def test_the_error_is_the_callers():
    with pytest.raises(UsageError, match=r"^--effect: gain\.gain: got"):
        check_values({"gain": {"gain": -1.0}}, lambda *a, **k: UsageError(*a, file="--effect", **k))


def test_omitted_values_are_neutral(model, panda):
    contact = complete(CATALOGUE["contact"], {"start": [1, 3], "end": [2, 4], "force": np.ones((2, 3))}, model)
    np.testing.assert_allclose(contact["point"], np.tile(model.theta[1:4] / model.theta[0], (2, 1)))
    cable = complete(CATALOGUE["cable"], {}, model._replace(arm=panda))
    assert cable["link"] == 4  # the forearm of a seven-joint arm
    assert cable["stiffness"] == 0
    assert all(value.dtype == jnp.float64 for value in cable.values())


@pytest.mark.parametrize(
    ("moments", "stderr", "possible"),
    [
        ((2e-3, 2e-3, 1e-3), 1e-5, True),
        ((0.0, 0.0, 0.0), 1e-5, True),  # a point mass
        ((1e-3, -3e-4, 1e-3), 2e-4, True),  # negative by chance
        ((1e-3, -5e-4, 1e-3), 2e-4, False),
    ],
)
def test_no_body_has_a_negative_moment_of_inertia(moments, stderr, possible):
    turn = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()
    inertia = (turn @ np.diag(moments) @ turn.T)[np.triu_indices(3)]
    judge = CATALOGUE["tool_inertia"].fit.possible
    assert judge({"inertia": inertia.tolist()}, {"inertia": np.full(6, stderr).tolist()}) is possible
