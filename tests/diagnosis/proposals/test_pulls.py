"""A cable is found where its likelihood has many maxima."""

import numpy as np
import pytest

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.diagnosis.diagnose import diagnose
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.setup import parse_setup


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_cable_from_the_forearm_is_found_with_all_its_numbers(seed):
    """A soft cable from far away makes nearly the same force, so few starting points end at the right one."""
    setup = parse_setup(SETUP, "setup.toml")
    rng = np.random.default_rng(seed)
    true = {
        "stiffness": rng.uniform(8, 30),
        "rest_length": rng.uniform(0.1, 0.2),
        "anchor": np.array([0.1, 0.0, 0.93]) + rng.uniform(-0.03, 0.03, 3),
        "link": 5.0,
        "attachment": np.array([0.0, 0.0, 0.1]),
    }
    log = simulate(setup, {"cable": true}, duration=40.0, rate=200.0, seed=seed).log
    found = diagnose(setup, [log], ["a log"])
    assert found.verdict == "explained"
    (cable,) = found.causes
    for name in ("stiffness", "rest_length", "anchor", "attachment"):
        error = np.abs(np.asarray(cable.parameters[name]) - true[name])
        assert (error < 3.5 * np.asarray(cable.stderr[name])).all()
    assert cable.parameters["stiffness"] == pytest.approx(true["stiffness"], rel=0.1)
