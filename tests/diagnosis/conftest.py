"""The setup of the demonstration's robot, and logs of it."""

import pytest
from demo_logs import recorder

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup import parse_setup


@pytest.fixture(scope="module")
def setup():
    return parse_setup(SETUP, "nominal.toml")


@pytest.fixture(scope="module")
def record(setup):
    """(effects or None) -> a log of 20 s."""
    return recorder(params_from_setup(setup), 3)
