"""The wrench of contacts that were added to a log: place, size, and correctness of the error bars."""

import numpy as np
import pytest
from small_archive import TABLES

import ftbias_jax as ft

JOINTS = {"position_noise_std": 1e-5, "velocity_noise_std": 1e-4, "process_noise_density": 0.1}
PUSHES = ((8.0, 10.0, [4, 0, -6, 0, 0.1, 0]), (18.0, 18.6, [0, -9, 0, 0.2, 0, 0]))
"""s, s, and N, Nm: wrench of the environment on the tool."""
NOISE = np.repeat([0.1, 0.004], 3)
START = 1000.0


@pytest.fixture(scope="module")
def pushed():
    """The result of a slow arm's log at 100 Hz with a bias of a newton that drifts, and the true contact wrench."""
    rng = np.random.default_rng(0)
    t = np.arange(3000) * 0.01
    q = np.sin(t[:, None] * [0.3, 0.4]) + 1e-5 * rng.normal(size=(len(t), 2))
    up = np.stack([-np.sin(q[:, 1]), np.zeros(len(t)), np.cos(q[:, 1])], 1)  # of the base, in the sensor's frame
    weight = 0.7 * 9.81 * up
    truth = np.zeros((len(t), 6))
    for start, end, wrench in PUSHES:
        truth[(t >= start) & (t < end)] = wrench
    on_tool = np.concatenate([weight, np.cross([0, 0, 0.06], weight)], 1) - truth  # the sensor reacts to the push
    bias = 1 + 0.01 * t[:, None] * NOISE
    setup = ft.parse_setup({**TABLES, "joints": JOINTS})
    dq = [0.3, 0.4] * np.cos(t[:, None] * [0.3, 0.4]) + 1e-4 * rng.normal(size=q.shape)
    reading = on_tool - bias + NOISE * rng.normal(size=truth.shape)
    log = ft.Log.from_arrays(setup, START + t, q, reading, dq)
    return ft.filter_log(setup, log, unchecked=True), truth


def test_contacts_are_told_with_their_wrench(pushed):
    result, _ = pushed
    assert len(result.contacts) == len(PUSHES)
    for contact, (start, end, wrench) in zip(result.contacts, PUSHES, strict=True):
        assert contact.start == pytest.approx(START + start, abs=0.1)
        assert contact.end == pytest.approx(START + end, abs=0.1)
        # an edge of the interval may be a block inside or outside the push
        np.testing.assert_allclose(contact.wrench, wrench, rtol=0.1, atol=0.6 * NOISE.max())
        assert ((contact.std > 0.9 * NOISE) & (contact.std < 2 * NOISE)).all()
        assert (np.abs(contact.peak) >= np.abs(contact.wrench)).all()


def test_the_error_bars_of_the_contact_wrench_are_right(pushed):
    """This holds inside contacts, except at their edges, and outside; slow errors are slightly overestimated here."""
    result, truth = pushed
    error = (result.contact_wrench - truth) / result.contact_wrench_std
    inside = result.in_contact & truth.any(1)
    for rows in (inside, ~result.in_contact & ~truth.any(1)):
        rms = np.sqrt((error[rows] ** 2).mean(0))
        assert ((rms > 0.6) & (rms < 1.2)).all(), rms
    assert inside.sum() > 200
