import chex
import numpy as np
import pytest
from stated import PANDA

from ftbias_jax.errors import SetupError
from ftbias_jax.filtering import bias_filter
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup import parse_setup


def params_with(effects):
    return params_from_setup(parse_setup(PANDA | {"effects": effects}, "vibrating.toml"))


@pytest.mark.parametrize("rows", [1, 7])
def test_vibration_of_the_setup_is_noise_of_the_filter_and_no_effect(rows):
    variance = np.arange(1.0, 6 * rows + 1).reshape(rows, 6)
    params = params_with({"vibration": {"variance": variance.tolist()}})
    assert params.effects is None
    np.testing.assert_allclose(params.bias.vibration, np.broadcast_to(variance, (7, 6)))
    assert params_with({}).bias.vibration is None
    assert list(params_with({"vibration": {"variance": [0.1] * 6}, "gain": {"gain": 1.05}}).effects) == ["gain"]


def test_the_speed_from_which_vibration_grows_with_the_speed_alone_is_known_to_the_filter():
    rows = np.arange(1.0, 43).reshape(7, 6)
    noise = params_with({"vibration": {"variance": rows.tolist(), "speed": 0.06}}).bias
    dq = np.linspace(-1, 1, 7)
    expected = (dq**2 / np.sqrt(1 + (dq / 0.06) ** 2)) @ rows
    np.testing.assert_allclose(bias_filter.vibration(noise, dq), expected, rtol=1e-6)
    never = params_with({"vibration": {"variance": rows.tolist(), "speed": float("inf")}}).bias
    assert never.vibration_speed is None
    np.testing.assert_allclose(bias_filter.vibration(never, dq), dq**2 @ rows, rtol=1e-6)
    with pytest.raises(SetupError, match=r"effects\.vibration\.speed: got 0"):
        params_with({"vibration": {"variance": rows.tolist(), "speed": 0.0}})


@pytest.mark.parametrize("scale", [0.02, [0.5, 1, 2, 3, 4, 5]])
def test_a_known_noise_level_is_the_noise_of_the_sensor(scale):
    """It does not scale all noise: the model's error, which a filter measures relative to it, is independent of it."""
    stated = PANDA["sensor"] | {"noise_std": (np.broadcast_to(scale, 6) * parse_setup(PANDA).sensor.noise_std).tolist()}
    expected = params_from_setup(parse_setup(PANDA | {"sensor": stated}))
    chex.assert_trees_all_equal(params_with({"noise_level": {"scale": scale}}), expected)


def test_rows_must_fit_the_joints():
    with pytest.raises(SetupError, match=r"vibrating\.toml: effects\.vibration\.variance: has 3 rows.*7 joints"):
        params_with({"vibration": {"variance": [[0.1] * 6] * 3}})
