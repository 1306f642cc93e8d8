"""A jump of the bias takes no time, and its level does not depend on the pose."""

from types import SimpleNamespace

import numpy as np
import pytest

from ftbias_jax.diagnosis.evidence import causes
from ftbias_jax.diagnosis.evidence.causes import doubt_of
from ftbias_jax.diagnosis.hypothesis import Change, Hypothesis
from ftbias_jax.diagnosis.proposals import series
from ftbias_jax.diagnosis.regression.design_matrix import Columns
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.model.effects.catalogue import CATALOGUE

BINS = 400
TIMES = np.linspace(0, 40, BINS)
STEP = (TIMES > 20) * 1.0
LEVEL = np.array([1.0, -2.0, 0.5, 0.1, 0.2, -0.1])
GRAVITY = np.array([0.0, 0.0, -9.81])


def turns_about_x(angle):
    """R_base_sensor (3, 3, U) of a sensor that turns about x."""
    c, s, one, zero = np.cos(angle), np.sin(angle), np.ones_like(angle), np.zeros_like(angle)
    return np.array([[one, zero, zero], [zero, c, -s], [zero, s, c]])


def fitted(monkeypatch, turning, ramp=0.0):
    """A problem with only white noise, and a fit of a jump to it: the residual is noise."""
    monkeypatch.setattr(series, "whitened", lambda problem, columns: columns)
    monkeypatch.setattr(causes, "departs", lambda *given: True)
    load = np.random.default_rng(1).normal(size=(BINS, 6))
    monkeypatch.setattr(series, "readings", lambda problem, z: load[None])
    signals = SimpleNamespace(model=SimpleNamespace(gravity=GRAVITY))
    part = SimpleNamespace(nominal=SimpleNamespace(sensor_rotation=turns_about_x(turning)), used=BINS, signals=signals)
    h = Hypothesis("bias_jump", shapes=(STEP,), detail=Change(20.0, 0, ramp))
    white = np.repeat(STEP[None, :, None], 6, 2)
    noise = 0.1 * np.random.default_rng(0).normal(size=(BINS, 6))
    found = Fit((h,), np.zeros(3), LEVEL, noise, Columns(np.zeros((0, BINS, 6)), white), (), 0.0)
    return SimpleNamespace(parts=[part], catalogue=CATALOGUE), found, h


def test_a_level_that_stays_while_the_wrist_turns_is_not_doubted(monkeypatch):
    assert doubt_of(*fitted(monkeypatch, np.sin(TIMES))) == ""


def test_without_turning_after_the_jump_a_force_that_set_in_is_as_good(monkeypatch):
    said = doubt_of(*fitted(monkeypatch, np.where(TIMES < 20, np.sin(TIMES), 0.3)))
    assert "a force that set in then" in said
    assert "the wrist turns too little" in said


@pytest.mark.parametrize(("ramp", "doubtful"), [(0.0, False), (1.2, False), (2.4, True)])
def test_what_takes_seconds_is_no_jump(monkeypatch, ramp, doubtful):
    said = doubt_of(*fitted(monkeypatch, np.sin(TIMES), ramp))
    assert ("it took 2.4 s" in said) == doubtful


def test_what_a_fit_leaves_without_its_jump_is_noise_and_jump(monkeypatch):
    _, found, h = fitted(monkeypatch, np.sin(TIMES))
    rest, own = series.without(found, h)
    np.testing.assert_allclose(rest.error, found.error - STEP[:, None] * LEVEL)
    assert rest.columns.size == 0
    np.testing.assert_array_equal(own[0, :, 0], STEP)
