"""Recorded logs: smoothed in parts as whole, contact and slow errors found in simulated ones, and honest error bars."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_series import gauss_markov

from ftbias_jax.filtering import filter_log
from ftbias_jax.filtering.adapt.log_noise import nothing
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.recorded import prepare as preparing
from ftbias_jax.filtering.recorded import whole
from ftbias_jax.filtering.recorded.bias import filter_prepared
from ftbias_jax.filtering.recorded.ready import in_parts, ready_to_filter
from ftbias_jax.filtering.result import join
from ftbias_jax.filtering.samples import samples_from_log
from ftbias_jax.io.log import Log
from ftbias_jax.model import simulate
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.model.simulate import Trajectory
from ftbias_jax.setup import parse_setup

SETUP = {
    "robot": {
        "joints": [
            {"axis": [0, 0, 1], "point": [0, 0, 0]},
            {"axis": [0, 1, 0], "point": [0, 0, 0.3]},
            {"axis": [1, 0, 0], "point": [0, 0, 0.5]},
        ],
        "flange": {"translation": [0.1, 0, 0.6]},
    },
    "sensor": {"noise_std": [0.1, 0.004]},
    "tool": {"mass": 0.7, "center_of_mass": [0.01, 0, 0.06], "inertia": [0.002, 0, 0, 0.002, 0, 0.001]},
    "joints": {"position_noise_std": 1e-4, "velocity_noise_std": 1e-3},
}
RATE, SECONDS = 250, 30
FORCE = np.array([6.0, -3.0, 0, 0, 0.1, 0])
"""N, Nm: what the environment exerts on the tool."""


def with_wrench(log, change):
    return log._replace(wrench=log.wrench + change)


@pytest.fixture(scope="module")
def setup():
    return parse_setup(SETUP)


@pytest.fixture(scope="module")
def made(setup):
    """A simulated log of an arm in motion, and its true bias (T, 6)."""
    t = np.arange(RATE * SECONDS) / RATE
    rate, size = np.array([0.9, 0.7, 1.3]), np.array([0.8, 0.6, 1.0])
    phase = t[:, None] * rate + [0, 1, 2]
    motion = (size * np.sin(phase), size * rate * np.cos(phase), -size * rate**2 * np.sin(phase))
    truth = simulate.simulate(jax.random.key(0), params_from_setup(setup), Trajectory(*map(jnp.asarray, (t, *motion))))
    log = Log(*(np.array(x) for x in (truth.t, truth.q, truth.dq, truth.wrench)), np.full(len(t), np.nan))
    return log, np.asarray(truth.bias)


@pytest.fixture(scope="module")
def likeliest(setup, made):
    return filter_log.likeliest_params(setup, samples_from_log(made[0]))


def record(likeliest, log):
    """What the log shows, and its result."""
    first_q = log.q[0]
    found = whole.filter_recorded(likeliest, first_q, lambda: in_parts(log, likeliest), len(log.t), Options())
    return found, join(list(found.results()))


@pytest.fixture(scope="module")
def clean(likeliest, made):
    return record(likeliest, made[0])


@pytest.fixture(scope="module")
def touched(likeliest, made):
    """The same log with a contact between 12.3 and 13.9 s."""
    log, _ = made
    inside = (log.t >= 12.3) & (log.t < 13.9)
    # The reading is what the sensor exerts on the tool: a push on the tool lowers it.
    return record(likeliest, with_wrench(log, inside[:, None] * -FORCE))


def test_a_log_that_is_as_stated_shows_nothing(clean, made):
    found, result = clean
    assert found.noise.contacts == ()
    assert found.noise.slow is None or not found.noise.slow.std.any()
    assert not found.noise.vibration.per_speed.any()
    np.testing.assert_array_equal(found.noise.vibration.level, 1)
    assert not found.noise.offset.any()
    assert (found.noise.inflation < 1.5).all()
    assert result.used.mean() > 0.999
    error = np.abs(result.bias - made[1]) / result.bias_std
    assert error[RATE:].max() < 4
    np.testing.assert_allclose(result.contact_wrench, result.wrench_tool - result.wrench_unbiased)


def test_a_contact_is_left_out_and_told(clean, touched, made):
    found, result = touched
    (contact,) = found.noise.contacts
    assert (contact.start, contact.end) == pytest.approx((12.3, 13.9), abs=0.1)
    inside = (result.t > 12.3) & (result.t < 13.9)
    assert not result.used[inside].any()
    assert result.used[(result.t < 12) | (result.t > 14.2)].mean() > 0.999
    error = np.abs(result.bias - made[1]) / result.bias_std
    assert error[RATE:].max() < 4
    np.testing.assert_allclose(result.bias[-1], clean[1].bias[-1], atol=clean[1].bias_std[-1].max())
    std = np.hypot(result.reading_std, result.bias_std)[inside] / np.sqrt(inside.sum())
    middle = result.contact_wrench[inside].mean(0)
    assert (np.abs(middle - FORCE) < 4 * std.mean(0) + 4 * result.bias_std[inside].mean(0)).all()


def test_slow_errors_widen_the_error_bars_to_what_they_are_worth(likeliest, made):
    """The filter as stated claims to know the bias several times better than it does."""
    log, truth = made
    std = np.repeat([0.3, 0.012], 3)
    shifted = with_wrench(log, gauss_markov(np.random.default_rng(1), log.t, std, 0.5))
    found, result = record(likeliest, shifted)
    assert (found.noise.slow.std > 0).all()
    off = np.abs(result.bias - truth)[-1]
    assert (off < 3.5 * result.bias_std[-1]).all()
    parts = list(preparing.prepare(likeliest, log.q[0], in_parts(shifted, likeliest), Options()))
    stated = join(list(filter_prepared(likeliest, parts, Options(), nothing())))
    assert (stated.bias_std[-1] < result.bias_std[-1] / 2.5).all()
    assert (off / stated.bias_std[-1]).max() > 3.5


def test_stated_vibration_counts_once(likeliest, made):
    """The variance of a part contains what the setup states; the filter adds nothing to it."""
    per_speed = jnp.asarray(np.full((3, 6), 4.0) * np.repeat([0.1, 0.004], 3) ** 2)
    params = likeliest._replace(bias=likeliest.bias._replace(vibration=per_speed))
    log = made[0]
    (plain,) = preparing.prepare(likeliest, log.q[0], [log], Options())
    (part,) = preparing.prepare(params, log.q[0], [log], Options())
    added = plain.joints.mean[:, 1] ** 2 @ np.asarray(per_speed)
    np.testing.assert_allclose(part.variance, plain.variance + added, rtol=1e-6)
    (result,) = filter_prepared(params, [part], Options(), nothing())
    np.testing.assert_allclose(result.reading_std**2, part.variance, rtol=1e-6)


def test_the_noise_of_samples_is_what_the_log_shows(likeliest, made):
    """A sensor twice as noisy as stated: the innovations scatter as the filter says."""
    log, _ = made
    noise = np.random.default_rng(3).normal(0, np.sqrt(3) * np.repeat([0.1, 0.004], 3), log.wrench.shape)
    found, result = record(likeliest, with_wrench(log, noise))
    np.testing.assert_allclose(found.noise.vibration.level, 4, rtol=0.15)
    nis = np.nanmean((result.innovation / result.innovation_std)[RATE:] ** 2, axis=0)
    np.testing.assert_allclose(nis, 1, atol=0.1)


def test_parts_are_the_whole(likeliest, made, clean, monkeypatch):
    """Joints smoothed with some samples of the next part, and read a second time as if the log were long."""
    log, _ = made
    (one,) = preparing.prepare(likeliest, log.q[0], [log], Options())
    for module in (filter_log, preparing):
        monkeypatch.setattr(module, "CHUNK", 2048)
    monkeypatch.setattr(preparing, "LOOKAHEAD", 512)
    monkeypatch.setattr(whole, "MOST_KEPT", 1000)
    parts = list(preparing.prepare(likeliest, log.q[0], in_parts(log, likeliest), Options()))
    assert [len(part.log.t) for part in parts] == [2048, 2048, 2048, 7500 - 3 * 2048]
    for name in ("wrench_tool", "variance", "known_bias"):
        joined, expected = np.concatenate([getattr(part, name) for part in parts]), getattr(one, name)
        np.testing.assert_allclose(joined, expected, rtol=0, atol=1e-9 * np.abs(expected).max(), err_msg=name)
    for got, expected in zip(zip(*(part.joints for part in parts), strict=True), one.joints, strict=True):
        np.testing.assert_allclose(np.concatenate(got), expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    assert sum(part.joint_log_likelihood for part in parts) == pytest.approx(one.joint_log_likelihood, rel=1e-9)

    reads = []

    def read():
        reads.append(1)
        return in_parts(log, likeliest)

    found = whole.filter_recorded(likeliest, log.q[0], read, len(log.t), Options())
    result = join(list(found.results()))
    assert len(reads) == 2
    # 2048 samples are no whole number of blocks, so the noise found is not quite the same.
    np.testing.assert_allclose(found.noise.inflation, clean[0].noise.inflation, rtol=0.2)
    one = whole.with_variance(one, likeliest, found.noise)
    expected = join(list(filter_prepared(found.params, [one], Options(gate=whole.GATE), found.noise)))
    for name in ("t", "bias", "drift", "bias_std", "innovation", "used", "reading_std", "slow_error", "log_likelihood"):
        got, other = (np.asarray(getattr(x, name), float) for x in (result, expected))
        np.testing.assert_allclose(got, other, rtol=1e-8, atol=1e-8 * np.nanmax(np.abs(other)), err_msg=name)


def test_a_filter_as_on_the_robot_looks_at_nothing(made, likeliest):
    log, _ = made
    setup = parse_setup({**SETUP, "bias": {"adapt": False}})
    ready = ready_to_filter(setup, likeliest, log.q[0], lambda: in_parts(log, likeliest), len(log.t))
    assert ready.noise.contacts == ()
    assert ready.noise.vibration is None
    density = likeliest.joint.process_density
    np.testing.assert_allclose(ready.params.joint.process_density, filter_log.LAG_GUARD * density)
    np.testing.assert_array_equal(ready.smoothing.joint.process_density, density)
    result, expected = join(list(ready.results())), filter_log.filter_with_params(ready.params, log)
    np.testing.assert_allclose(result.bias, expected.bias, rtol=0, atol=1e-12)
    assert result.used is None


def test_a_few_odd_readings_at_the_start_do_not_shut_the_gate_for_good(likeliest, made):
    """A torque alone is no contact, and ten readings far off are enough for a gate that trusts them."""
    log, bias = made
    odd = (np.arange(len(log.t)) < 10)[:, None] * np.array([0, 0, 0, 1.0, 0, 0])
    found, result = record(likeliest, with_wrench(log, odd))
    assert found.noise.begun_again
    assert found.noise.kept_out == 0
    assert not result.used[:10].any()
    assert result.used[10:].mean() > 0.99
    error = np.abs(result.bias - bias) / result.bias_std
    assert error[-1].max() < 4
