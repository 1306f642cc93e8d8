"""The rotation of the sensor on the flange: found for a draft, reported for a setup that states another one."""

from dataclasses import replace

import numpy as np
import pytest

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.commissioning.mounting import with_mounting
from ftbias_jax.errors import SetupError
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.runtime.progress import silent
from ftbias_jax.setup import parse_setup
from ftbias_jax.setup.rotations import rotation_from_rpy, vector_from_rotation

TRUE = parse_setup(SETUP)
TURNED = rotation_from_rpy(np.array([0.0, 0.0, np.pi / 4]))


@pytest.fixture(scope="module")
def log():
    """A log of 20 s of a sensor turned by 45 degrees; its tool is given along the axes of the sensor."""
    turned = replace(TRUE, sensor=replace(TRUE.sensor, rotation=TRUE.sensor.rotation @ TURNED))
    return simulate(turned, duration=20, rate=50, seed=4).log


def drafted(setup):
    """The setup as a draft states it: nothing of the sensor's place, and a tool with its standard errors."""
    sensor = replace(setup.sensor, rotation=np.eye(3), translation=np.zeros(3))
    return replace(setup, sensor=sensor, tool=replace(setup.tool, mass_std=0.1, center_of_mass_std=np.full(3, 0.02)))


def test_a_drafts_sensor_is_turned_as_the_log_shows(log):
    stated = drafted(TRUE)
    setup, (step,) = with_mounting(stated, [log], [log], silent)
    true = TRUE.sensor.rotation @ TURNED
    assert np.linalg.norm(vector_from_rotation(setup.sensor.rotation.T @ true)) < np.radians(0.2)
    assert (step.kept, step.kind) == (True, "mounting")
    assert setup.tool.mass == pytest.approx(TRUE.tool.mass, rel=0.02)
    assert setup.tool.mass_std == stated.tool.mass_std
    assert (setup.bias.model_std > 0).all()


def test_a_right_setup_is_left_as_it_is(log):
    turned = replace(TRUE, sensor=replace(TRUE.sensor, rotation=TRUE.sensor.rotation @ TURNED))
    setup, steps = with_mounting(turned, [log], [log], silent)
    assert setup is turned
    assert steps == ()


def test_what_the_owner_states_is_not_changed_but_questioned(log):
    with pytest.raises(SetupError, match=r"the sensor's axes are turned.*identify --mounting"):
        with_mounting(TRUE, [log], [log], silent)
