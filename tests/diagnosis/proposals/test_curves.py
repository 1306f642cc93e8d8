import numpy as np
import pytest

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.diagnosis.diagnose import diagnose
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.setup import parse_setup

FZ = np.arange(6) == 2


@pytest.mark.slow
@pytest.mark.parametrize("curved", [True, False])
def test_a_curved_gauge_is_no_certain_gain_and_another_gain_is(curved):
    setup = parse_setup(SETUP)
    made = simulate(setup, duration=40.0, rate=125.0, seed=3)
    load = made.log.wrench[:, FZ]
    change = 0.01 * load**2 if curved else 0.05 * load
    diagnosis = diagnose(setup, [made.log._replace(wrench=made.log.wrench + np.where(FZ, change, 0.0))])
    causes = [cause.effect for cause in diagnosis.causes]
    if curved:
        assert diagnosis.verdict != "explained"
        assert causes == [] or "not linear" in diagnosis.causes[0].doubt
    else:
        assert diagnosis.verdict == "explained"
        assert causes == ["gain"]


def test_it_is_tried_for_gains_only():
    assert [name for name, effect in CATALOGUE.items() if effect.fit.by_load] == ["gain"]
