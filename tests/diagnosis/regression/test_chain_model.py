"""Programs compiled in advance are the ones that the search calls, and failures of compiling are reported."""

import time

import jax
import numpy as np
import pytest

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.diagnosis.problem import make_problem
from ftbias_jax.diagnosis.regression import chain_model
from ftbias_jax.diagnosis.regression.chain_model import compiled_ahead, outline, padded_bins
from ftbias_jax.diagnosis.samples import smoothed
from ftbias_jax.io.log import Log
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup import parse_setup


@pytest.fixture(scope="module")
def setup():
    known = {"gain": {"gain": [1.1, 1, 1, 1, 1, 1]}, "low_pass": {"cutoff": 20}}
    return parse_setup(SETUP | {"effects": known}, "nominal.toml")


@pytest.fixture(scope="module")
def log():
    """A log of 10 s in which the joints move in sines."""
    rng = np.random.default_rng(0)
    t = np.arange(2000) / 200.0
    q = np.sin(t[:, None] + np.arange(7.0))
    return Log(t, q, np.cos(t[:, None] + np.arange(7.0)), rng.normal(size=(2000, 6)), np.full(2000, np.nan))


def test_an_outline_is_like_the_problem(setup, log):
    """The outline matches down to weak types; otherwise JAX would compile every program twice."""
    problem, _ = make_problem(setup, [log])
    (part,) = problem.parts
    expected = (part.signals, problem.known, part.nominal)
    got = outline(params_from_setup(setup), padded_bins(log))
    assert jax.tree.structure(got) == jax.tree.structure(expected)
    for a, b in zip(jax.tree.leaves(got), jax.tree.leaves(expected), strict=True):
        assert (a.shape, a.dtype, a.weak_type) == (b.shape, b.dtype, b.weak_type)


@pytest.mark.parametrize(("place", "name"), [(0, "smoothed_joints"), (1, "_predicted")])
def test_the_smoother_is_compiled_for_what_it_will_smooth(setup, log, place, name, monkeypatch):
    asked, program = [], getattr(smoothed, name)

    class Program:
        def prepare(self, *arguments, **static):
            asked.append((*_shapes(arguments), static))

        def __call__(self, *arguments, **static):
            if not any(isinstance(x, jax.core.Tracer) for x in jax.tree.leaves(arguments)):
                asked.append((*_shapes(arguments), static))
            return program(*arguments, **static)

    monkeypatch.setattr(smoothed, name, Program())
    tuple(chain_model.programs_of_search(setup, [log, log]))[place]()
    make_problem(setup, [log])
    ahead, called = asked
    assert ahead == called


def _shapes(tree):
    leaves, structure = jax.tree.flatten(tree)
    return structure, [(x.shape, x.dtype) for x in leaves]


def test_an_error_of_the_compiler_is_told(monkeypatch):
    def fail():
        raise RuntimeError("out of memory")

    monkeypatch.setattr(chain_model, "programs_of_search", lambda setup, logs: iter([fail]))
    with pytest.raises(RuntimeError, match="out of memory"), compiled_ahead(None, []):
        pass


def test_after_an_error_in_the_block_nothing_more_is_compiled(monkeypatch):
    """Compilations that have begun are waited for; those still queued are cancelled."""
    compiled = []

    def slowly():
        time.sleep(0.3)
        compiled.append(1)

    monkeypatch.setattr(chain_model, "programs_of_search", lambda setup, logs: iter([slowly] * 5))
    with pytest.raises(ValueError, match="log"), compiled_ahead(None, []):
        raise ValueError("log")
    assert len(compiled) < 5
