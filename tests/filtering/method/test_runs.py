"""Sets of logs: logs that request the same run are run together, and results keep their order."""

import jax
import numpy as np
import pytest

from ftbias_jax.errors import LogError
from ftbias_jax.filtering.method import runs
from ftbias_jax.filtering.method.runs import Run, in_sets
from ftbias_jax.filtering.noise.blocks import Layout
from ftbias_jax.types import Sample

LAYOUT = Layout(5, 0.1)


@pytest.fixture
def counts(monkeypatch):
    """Shapes of all runs; the fake program doubles the parameters, and its states are the dt."""
    done = []

    def doubled(params, samples, *, options, method, layout):
        done.append(samples.dt.shape)
        return 2 * params, samples.dt, ()

    monkeypatch.setattr(runs, "filter_each", doubled)
    return done


def steps(task):
    """Request ``times`` runs one after the other, each with the result of the previous one."""
    value, length, times = task
    if times < 0:
        raise LogError("cannot be read")
    dt = np.full(length, 0.02)
    for _ in range(times):
        nothing = np.full((length, 1), np.nan)
        value, states, _ = yield Run(np.asarray(value), Sample(dt, nothing, nothing, nothing), None, ("a",), LAYOUT)
        np.testing.assert_array_equal(states, dt)
    return float(value)


TASKS = [(1.0, 8, 1), (2.0, 16, 2), (3.0, 8, 3), (4.0, 8, -1), (5.0, 8, 0), (6.0, 8, 1), (7.0, 16, 1)]
RESULTS = [2.0, 8.0, 24.0, None, 5.0, 12.0, 14.0]


def test_results_are_in_order_however_many_runs_a_log_needs(counts):
    found = list(in_sets(steps, jax.devices()[0], iter(TASKS)))
    assert [None if isinstance(x, LogError) else x for x in found] == RESULTS
    # Three of one length (padded to four), two of the other, then the logs that request further runs.
    assert counts == [(4, 8), (2, 16), (1, 8), (1, 16), (1, 8)]


def test_no_more_is_held_than_a_set(counts, monkeypatch):
    monkeypatch.setattr(runs, "SET_SAMPLES", 24)
    taken = []
    found = in_sets(steps, jax.devices()[0], (taken.append(x) or x for x in TASKS))
    assert next(found) == RESULTS[0]
    assert taken == TASKS[:2]
    assert [None if isinstance(x, LogError) else x for x in found] == RESULTS[1:]
    assert max(count * length for count, length in counts) <= 24 + 8
