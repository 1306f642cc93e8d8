"""Terms take the place of effects that explain the logs only if they hold as well on blocks that were held out."""

from types import SimpleNamespace

import pytest

from ftbias_jax.diagnosis.terms import describe


@pytest.mark.parametrize(("removed", "holds"), [(0.43, False), (0.97, False), (0.99, True), (1.01, True)])
def test_terms_must_remove_as_much_of_the_gap_as_what_they_replace(monkeypatch, removed, holds):
    monkeypatch.setattr(describe, "gap_removed", lambda problem, before, after: after)

    def hold_out(fit, before):
        return SimpleNamespace(error=fit)

    assert describe._holds(None, hold_out, SimpleNamespace(error=0.0), removed, 1.0) is holds
