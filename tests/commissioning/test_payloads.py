"""Parts that a tool carries: found, reported, and included in what follows."""

import numpy as np
import pytest
from demo_logs import recorder

import ftbias_jax as ft
from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.cli.main import main
from ftbias_jax.commissioning import payloads
from ftbias_jax.diagnosis.terms.found import found_term
from ftbias_jax.model.effects.terms.types import Term
from ftbias_jax.model.params import params_from_setup

POINT = np.array([0.02, -0.03, 0.13])
TIMES = {"time": np.array([4.217, 11.6]), "takes": np.array(0.06)}
LOAD = Term("acceleration", "payload", "base", "force", 0, (), TIMES, POINT, np.array([0.3]))


class Told:
    """A diagnosis with or without a load."""

    def __init__(self, *terms):
        self.terms, self.sentence = terms, "The log agrees with the setup."


@pytest.fixture
def told(monkeypatch):
    """(terms) -> replace the diagnosis by one with these terms."""
    return lambda *terms: monkeypatch.setattr(payloads, "diagnose", lambda *a, **k: Told(*terms))


def part():
    errors = {"time": [0.003, 0.004], "takes": 0.01, "point": [1e-3, 2e-3, 1e-3]}
    return found_term(LOAD, np.array([0.006]), "a load", "a load", (1.0, 0.1))._replace(parameters_stderr=errors)


def test_loads_become_part_of_the_setup_and_other_terms_do_not(told):
    setup = ft.parse_setup(SETUP)
    told(part()._replace(form="swing"), part())
    found = ft.identify_payloads(setup, None)
    assert [term["form"] for term in found.setup.effects["term"]] == ["payload"]
    where, when = "(20.0 ± 1.0, -30.0 ± 2.0, 130.0 ± 1.0) mm", "from 4.217 to 11.6 s (times ± 0.004 s)"
    assert str(found) == f"load of 0.3000 ± 0.0060 kg at {where}, {when}"


def test_a_load_that_is_lighter_than_nothing_is_an_error_of_the_tool(told):
    told(part(), part()._replace(coefficients={"kg": -0.08}))
    with pytest.raises(ft.LogError, match=r"load of -0.0800 .* the tool that the setup states is not the one"):
        ft.identify_payloads(ft.parse_setup(SETUP), None)


def test_a_log_without_a_load_is_refused_with_what_it_shows(told):
    told()
    with pytest.raises(ft.LogError, match="no load that is taken up or put down: The log agrees"):
        ft.identify_payloads(ft.parse_setup(SETUP), None)


@pytest.mark.slow
def test_the_tool_is_found_beside_what_it_carries(tmp_path, capsys):
    setup = ft.parse_setup(SETUP)
    log = recorder(params_from_setup(setup), 3)({"term": {"1": LOAD}})
    stated, file, out = tmp_path / "setup.toml", tmp_path / "log.npz", tmp_path / "found.toml"
    setup.save(stated)
    np.savez(file, t=log.t, q=log.q, dq=log.dq, wrench=log.wrench)
    assert main(["identify", str(file), "--setup", str(stated), "--payloads", "-o", str(out)]) == 0
    assert "load of 0.3" in capsys.readouterr().out
    found = ft.load_setup(out)
    (load,) = found.effects["term"]
    np.testing.assert_allclose(load["time"], TIMES["time"], atol=0.01)
    np.testing.assert_allclose(load["point"], POINT, atol=0.003)
    assert abs(found.tool.mass / setup.tool.mass - 1) < 0.02
