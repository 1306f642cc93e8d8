"""Readings touched during the handover of a load get a low weight, and no others do."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.diagnosis.problem import make_problem
from ftbias_jax.diagnosis.regression.fit import base
from ftbias_jax.diagnosis.terms.grid import make_term
from ftbias_jax.diagnosis.terms.loads import all_carried, without_touches
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup import parse_setup


class Bins(NamedTuple):
    t: np.ndarray
    variance: np.ndarray

    def louder(self, added):
        return self._replace(variance=self.variance + added)


def test_only_what_stands_out_beside_a_handover_is_louder():
    bins = Bins(np.arange(100) / 10, np.full((100, 6), 4.0))
    load = make_term("acceleration", "payload", "base", "force", parameters={"time": [2.0, 7.0], "takes": 0.1})
    load = replace(load, coefficients=np.array([0.3]))
    error = np.ones((100, 6))
    error[[21, 68, 45], 2] = 10, -10, 10  # pushed while gripped, while released, and once in between
    louder = without_touches(bins, load, error).variance
    changed = np.argwhere(louder != bins.variance).tolist()
    assert changed == [[21, 2], [68, 2]]
    np.testing.assert_allclose(louder[21, 2], 4 + 100 * 4)  # the residual is now one standard deviation


@in_float64
def test_a_tool_that_is_not_as_stated_is_no_load_that_is_taken_up_at_once():
    setup = parse_setup(SETUP)
    log = simulate(setup, {}, duration=20, rate=100, seed=13).log
    stated = replace(setup, tool=replace(setup.tool, mass=1.2 * setup.tool.mass))
    problem, _ = make_problem(stated, [log])
    assert all_carried(problem, base(problem)) is None
