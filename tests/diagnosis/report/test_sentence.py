"""The verdict in a sentence, and what it says of noise that the diagnosis does not use."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ftbias_jax.cli.commands import demo
from ftbias_jax.diagnosis.report.sentence import not_whitened, sentence_of
from ftbias_jax.setup import parse_setup

SETUP = parse_setup(demo.SETUP)


@pytest.mark.parametrize(("std", "told"), [(None, False), (np.zeros(6), False), (np.array([0, 0.1, 0, 0, 0, 0]), True)])
def test_correlated_noise_of_the_setup_is_told_to_be_left_out(std, told):
    setup = replace(SETUP, sensor=replace(SETUP.sensor, correlated_std=std, correlated_time=np.ones(6)))
    assert ("correlated noise is not used" in not_whitened(setup)) is told


@pytest.mark.parametrize(
    ("names", "words"), [(["gain"], "gain explains"), (["gain", "cable"], "gain and cable explain ")]
)
@pytest.mark.parametrize("verdict", ["explained", "partly_explained"])
def test_two_causes_are_told_in_the_plural(verdict, names, words):
    gap = SimpleNamespace(before_sigmas=3.0, after_sigmas=1.0, shrink=0.9)
    causes = tuple(SimpleNamespace(effect=name, indistinguishable_from=()) for name in names)
    assert sentence_of(verdict, gap, causes).startswith(words)
