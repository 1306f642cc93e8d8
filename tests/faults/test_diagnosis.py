"""What a diagnosis must survive: no wrench, unknown standard errors, values that no setup can state."""

from types import SimpleNamespace

import numpy as np
import pytest
from small_fits import small_fit

from ftbias_jax.diagnosis.check_effects import typed_errors
from ftbias_jax.diagnosis.diagnose import diagnose
from ftbias_jax.diagnosis.evidence import estimates
from ftbias_jax.diagnosis.hypothesis import Hypothesis
from ftbias_jax.errors import LogError
from ftbias_jax.io.log import Log
from ftbias_jax.model.effects.catalogue import CATALOGUE


def test_a_wrench_that_is_all_nan(setup):
    t = np.arange(500) * 0.01
    log = Log(t, np.zeros((500, 2)), np.zeros((500, 2)), np.full((500, 6), np.nan), np.full(500, np.nan))
    with pytest.raises(LogError, match="no wrench data: all values are NaN"):
        diagnose(setup, [log])


def test_a_wrench_that_is_clipped_on_all_axes(setup):
    """Nine of ten readings are at the end of the range, and the others were selected by noise."""
    t = np.arange(2000) * 0.01
    swing = np.sin(t[:, None] + np.arange(6)) * np.repeat([10, 0.5], 3)
    wrench = np.clip(swing, -0.1 * np.abs(swing).max(0), 0.1 * np.abs(swing).max(0))
    q = np.sin(t)[:, None] * [0.5, 0.3]
    log = Log(t, q, np.full(q.shape, np.nan), wrench, np.full(len(t), np.nan))
    with pytest.raises(LogError, match=r"only .* usable readings remain"):
        diagnose(setup, [log], unchecked=True)


@pytest.mark.parametrize("how", ["NaN", "singular"])
def test_a_covariance_that_is_no_number_leaves_the_standard_error_unknown(monkeypatch, how):
    def covariance(problem, fit, further):
        if how == "singular":
            raise np.linalg.LinAlgError("Singular matrix")
        return np.full((2, 2), np.nan)

    monkeypatch.setattr(estimates, "covariance", covariance)

    def prepare(signals, z, catalogue):
        return lambda signals, z: {"tool_mass": {"mass": 0.7 + z[3]}}

    monkeypatch.setattr(estimates.chain_model, "to_values", SimpleNamespace(prepare=prepare))
    problem = SimpleNamespace(parts=[SimpleNamespace(signals=None)], catalogue=CATALOGUE)
    fit = small_fit(np.ones((2, 5, 6)), np.ones((5, 6)), (3, 4))
    values, stderr = estimates.parameters(problem, fit, Hypothesis("tool_mass", (3,), (0.0,)))
    assert values == {"mass": 0.7}
    assert np.isnan(stderr["mass"])


def test_equations_without_a_solution_end_in_an_error_of_ours():
    with (
        pytest.raises(
            LogError, match="the log cannot be diagnosed, because a linear system is singular: Singular matrix"
        ),
        typed_errors(()),
    ):
        np.linalg.inv(np.zeros((2, 2)))
