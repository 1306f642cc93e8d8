"""Terms of logs that the catalogue does not explain, and logs that it explains without terms."""

import numpy as np
import pytest
from demo_logs import recorder

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.diagnosis.diagnose import diagnose
from ftbias_jax.model.effects.terms.types import Term
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup import load_setup, parse_setup

POINT = np.array([0.02, -0.03, 0.13])


@pytest.fixture(scope="module")
def setup():
    return parse_setup(SETUP)


@pytest.fixture(scope="module")
def record(setup):
    """(effects or None) -> a log of 20 s."""
    return recorder(params_from_setup(setup), 3)


@pytest.mark.slow
def test_drag_is_described_applied_and_then_gone(setup, record, tmp_path):
    drag = Term("velocity", "linear", "base", "force", 0, (), {}, POINT, np.array([4.0]))
    log = record({"term": {"1": drag}})
    found = diagnose(setup, [log], ["dragged"])
    assert found.verdict == "described"
    assert found.causes == ()
    (term,) = found.terms
    assert (term.drive, term.form, term.acts_as) == ("velocity", "linear", "force")
    assert abs(term.coefficients["N_per_m_s"] - 4.0) < 3 * term.stderr["N_per_m_s"]
    np.testing.assert_allclose(term.point, POINT, atol=0.01)
    assert term.shrink > 0.95
    assert "against the velocity of the tool" in found.sentence
    assert "not in the catalogue" in str(found)
    found.to_html(tmp_path / "report.html")
    assert "velocity along" in (tmp_path / "report.html").read_text()
    found.apply(setup).save(tmp_path / "fixed.toml")
    again = diagnose(load_setup(tmp_path / "fixed.toml"), [log], ["dragged"])
    assert (again.verdict, again.terms) == ("none", ())


@pytest.mark.slow
def test_without_terms_the_catalogue_answers_alone(setup, record):
    drag = Term("velocity", "linear", "base", "force", 0, (), {}, POINT, np.array([4.0]))
    found = diagnose(setup, [record({"term": {"1": drag}})], ["dragged"], without=("term",))
    assert found.terms == ()
    assert found.verdict in ("unknown", "partly_explained")


@pytest.mark.slow
def test_a_load_that_is_carried_is_told_with_its_mass_place_and_times(setup, record, tmp_path):
    times = np.array([4.217, 11.6])
    numbers = {"time": times, "takes": np.array(0.06)}
    load = Term("acceleration", "payload", "base", "force", 0, (), numbers, POINT, np.array([0.3]))
    log = record({"term": {"1": load}})
    found = diagnose(setup, [log], ["gripped"])
    assert (found.verdict, found.causes) == ("described", ())
    (term,) = found.terms
    assert term.form == "payload"
    assert abs(term.coefficients["kg"] - 0.3) < 0.003
    np.testing.assert_allclose(term.point, POINT, atol=0.003)
    np.testing.assert_allclose(term.parameters["time"], times, atol=0.01)
    assert "from 4.2" in found.sentence
    found.to_html(tmp_path / "report.html")
    found.apply(setup).save(tmp_path / "fixed.toml")
    again = diagnose(load_setup(tmp_path / "fixed.toml"), [log], ["gripped"])
    assert (again.verdict, again.terms) == ("none", ())
