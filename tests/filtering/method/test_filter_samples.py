"""The method over whole logs: against the textbook, mapped and differentiated, and on simulated contact and noise."""

from dataclasses import replace

import by_params
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_series import gauss_markov, wandering
from stated import YAW_PITCH_ROLL

import ftbias_jax as ft
from ftbias_jax.errors import UsageError
from ftbias_jax.filtering import bias_filter
from ftbias_jax.filtering.method import by_parts, ready, runs
from ftbias_jax.filtering.method.filter_samples import AS_STATED, METHOD, filter_samples
from ftbias_jax.filtering.method.passes import GATE
from ftbias_jax.filtering.method.ready import ready_to_filter
from ftbias_jax.filtering.method.runs import alone
from ftbias_jax.filtering.noise.blocks import layout_of
from ftbias_jax.filtering.params_for_log import LAG_GUARD, max_likelihood_params
from ftbias_jax.filtering.pipeline import predict_wrench
from ftbias_jax.filtering.process_models import integrated_jerk_noise, matrix
from ftbias_jax.filtering.result import join
from ftbias_jax.filtering.samples import samples_from_log, samples_of
from ftbias_jax.io import read_log
from ftbias_jax.io.cleaning import slices
from ftbias_jax.io.log import Log
from ftbias_jax.model import simulate
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.model.simulate import Trajectory
from ftbias_jax.model.wrench.tool_wrench import covariance_of_joints, joint_sensitivity
from ftbias_jax.setup import load_setup, parse_setup

RATE, SECONDS = 250, 30
FORCE = np.array([6.0, -3.0, 0, 0, 0.1, 0])
"""N, Nm: wrench of the environment on the tool."""


def with_wrench(log, change):
    return log._replace(wrench=log.wrench + change)


@pytest.fixture(scope="module")
def setup():
    return parse_setup(YAW_PITCH_ROLL)


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
    return max_likelihood_params(setup, samples_from_log(made[0]))


def filtered(setup, log, smooth=False):
    """What was estimated from the log, and its result."""
    found = alone(ready_to_filter(setup, slices(log), len(log.t), log.q[0], smooth=smooth))
    return found, join(list(found.results))


@pytest.fixture(scope="module")
def clean(setup, made):
    return filtered(setup, made[0])


@pytest.fixture(scope="module")
def touched(setup, made):
    """The same log with a contact between 12.3 and 13.9 s."""
    log, _ = made
    inside = (log.t >= 12.3) & (log.t < 13.9)
    # The reading is what the sensor exerts on the tool: a push on the tool lowers it.
    return filtered(setup, with_wrench(log, inside[:, None] * -FORCE))


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


def test_a_bias_that_wanders_is_followed_as_by_a_filter_that_knows_how_much(setup, made):
    log, truth = made
    more = 40 * setup.bias.noise_density
    added = wandering(np.random.default_rng(2), log.t, more)
    wild = with_wrench(log, -added)
    found, result = filtered(setup, wild)
    assert not found.noise.slow.std.any()
    np.testing.assert_allclose(np.log(found.noise.density / more), 0, atol=0.7)
    knows = filtered(replace(setup, bias=replace(setup.bias, noise_density=more)), wild)[1]
    ours, theirs = (np.sqrt(np.mean((x.bias - truth - added)[RATE:] ** 2, 0)) for x in (result, knows))
    assert (ours < 1.1 * theirs).all()
    assert np.mean(np.abs(result.bias - truth - added)[RATE:] < 1.96 * result.bias_std[RATE:]) > 0.9


def test_slow_errors_widen_the_error_bars_to_what_they_are_worth(setup, likeliest, made):
    """With stated noise, the filter claims to know the bias several times better than it does."""
    log, truth = made
    std = np.repeat([0.3, 0.012], 3)
    shifted = with_wrench(log, gauss_markov(np.random.default_rng(1), log.t, std, 0.5))
    found, result = filtered(setup, shifted)
    assert (found.noise.slow.std > 0).all()
    off = np.abs(result.bias - truth)[-1]
    assert (off < 3.5 * result.bias_std[-1]).all()
    _, stated, _ = by_params.found_in(likeliest, shifted, method=("smooth_joints", "filter_bias"))
    last = stated.bias_std[len(log.t) - 1]
    assert (last < result.bias_std[-1] / 2.5).all()
    assert (off / last).max() > 3.5


def test_the_noise_of_samples_is_what_the_log_shows(setup, made):
    """The sensor is twice as noisy as stated: the innovations scatter as the filter predicts."""
    log, _ = made
    noise = np.random.default_rng(3).normal(0, np.sqrt(3) * np.repeat([0.1, 0.004], 3), log.wrench.shape)
    found, result = filtered(setup, with_wrench(log, noise))
    np.testing.assert_allclose(found.noise.vibration.level, 4, rtol=0.15)
    nis = np.nanmean((result.innovation / result.innovation_std)[RATE:] ** 2, axis=0)
    np.testing.assert_allclose(nis, 1, atol=0.1)


def test_parts_are_the_whole(setup, made, clean, monkeypatch):
    """Joints are smoothed with some samples of the next part, and the log is read again for every pass."""
    log, _ = made
    for smaller, name, value in ((ready, "MOST", 1000), (by_parts, "PART", 2050), (by_parts, "LOOKAHEAD", 512)):
        monkeypatch.setattr(smaller, name, value)
    reads = []

    def parts(size):
        reads.append(size)
        return slices(log)(size)

    found = alone(ready_to_filter(setup, parts, len(log.t), log.q[0]))
    results = list(found.results)
    assert [len(part.t) for part in results] == [2050, 2050, 2050, 7500 - 3 * 2050]
    assert reads[1:] == [2050, 2050]
    got, expected = join(results), clean[1]
    # 2050 samples are no whole number of blocks, so the estimated noise differs slightly.
    np.testing.assert_allclose(found.noise.inflation, clean[0].noise.inflation, rtol=0.2)
    np.testing.assert_array_equal(found.noise.vibration.level, 1)
    for name in ("t", "q", "dq", "ddq", "ddq_std", "wrench_tool", "reading_std", "used"):
        one, other = (np.asarray(getattr(x, name), float) for x in (got, expected))
        np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-7 * np.nanmax(np.abs(other)), err_msg=name)
    std = expected.bias_std / clean[0].noise.inflation
    np.testing.assert_allclose(got.bias, expected.bias, rtol=0, atol=0.05 * std.min())
    np.testing.assert_allclose(got.bias_std / found.noise.inflation, std, rtol=1e-3)
    assert got.log_likelihood == pytest.approx(expected.log_likelihood, rel=1e-6)


def test_a_filter_as_on_the_robot_looks_at_nothing(made, likeliest, monkeypatch):
    """Its result is that of the pipeline, whole and in parts."""
    log, _ = made
    found, result = filtered(parse_setup({**YAW_PITCH_ROLL, "bias": {"adapt": False}}), log)
    assert found.noise.contacts == ()
    assert found.noise.vibration is None
    assert result.used is None
    density = likeliest.joint.process_density
    np.testing.assert_allclose(found.params.joint.process_density, LAG_GUARD * density, rtol=1e-9)
    expected = by_params.filter_with_params(found.params, log)
    for name in ("bias", "ddq", "innovation_std"):
        np.testing.assert_allclose(getattr(result, name), getattr(expected, name), rtol=1e-9, atol=1e-8, err_msg=name)
    assert result.log_likelihood == pytest.approx(expected.log_likelihood, rel=1e-10)
    monkeypatch.setattr(ready, "MOST", 1000)
    monkeypatch.setattr(by_parts, "PART", 2048)
    _, in_parts = filtered(parse_setup({**YAW_PITCH_ROLL, "bias": {"adapt": False}}), log)
    np.testing.assert_allclose(in_parts.bias, result.bias, rtol=0, atol=1e-10)
    assert in_parts.log_likelihood == pytest.approx(result.log_likelihood, rel=1e-10)


def test_a_few_odd_readings_at_the_start_do_not_shut_the_gate_for_good(setup, made):
    """A torque alone is no contact, and ten outliers are enough to mislead a gate that trusts them."""
    log, bias = made
    odd = (np.arange(len(log.t)) < 10)[:, None] * np.array([0, 0, 0, 1.0, 0, 0])
    found, result = filtered(setup, with_wrench(log, odd))
    assert found.noise.begun_again
    assert found.noise.kept_out == 0
    assert not result.used[:10].any()
    assert result.used[10:].mean() > 0.99
    error = np.abs(result.bias - bias) / result.bias_std
    assert error[-1].max() < 4


def test_one_odd_reading_at_the_start_costs_the_bias_nothing(setup, made, monkeypatch):
    """This holds even if the closed gate opens before half of the log is over; padding is not counted."""
    done = []

    def noted(*arguments, **named):
        done.append(filter_samples(*arguments, **named))
        return done[-1]

    monkeypatch.setattr(runs, "filter_samples", noted)
    log, bias = made
    odd = (np.arange(len(log.t)) < 1)[:, None] * 20 * setup.sensor.noise_std
    found, result = filtered(setup, with_wrench(log, odd))
    assert found.noise.begun_again
    assert result.used[1:].mean() > 0.99
    error = np.abs(result.bias - bias) / result.bias_std
    assert error[10:].max() < 5
    shut, opened = (infos for _, _, infos in done)
    assert len(shut.used) > len(log.t)
    used = np.asarray(shut.used)[: len(log.t)]
    assert used.mean() > 0.5
    assert float(shut.kept_out) == pytest.approx(1 - used.mean(), abs=1e-9)
    assert float(shut.kept_out_at_first) == pytest.approx(1 - used[: RATE + 1].mean(), abs=1e-9)
    assert opened.kept_out < 0.01


def textbook_joints(noise, dt, q, dq):
    """Mean (T, 3) and covariance (T, 3, 3) of one joint given past and future, computed with matrices."""
    density, position, velocity, prior = noise
    x, P = np.array([q[np.isfinite(q)][0], 0, 0]), np.diag(prior**2)
    ahead, now = [], []
    processes = jax.vmap(lambda h: integrated_jerk_noise(h, jnp.asarray(density)))(jnp.asarray(dt))
    for k, (A, Q) in enumerate(zip(*(np.asarray(jax.vmap(matrix)(rows)) for rows in processes), strict=True)):
        before, x, P = x, A @ x, A @ P @ A.T + Q
        lost = (np.diag(P) > prior**2)[:2].all()  # after a long gap it restarts, at rest at its last position
        ahead.append((A, Q, x, P, lost))
        if lost:
            x, P = before * [1, 0, 0], np.diag(prior**2)
        for entry, y, std in ((0, q[k], position), (1, dq[k], velocity)):
            if np.isfinite(y):
                gain = P[:, entry] / (P[entry, entry] + std**2)
                keep = np.eye(3) - np.outer(gain, np.eye(3)[entry])
                x, P = x + gain * (y - x[entry]), keep @ P @ keep.T + np.outer(gain, gain) * std**2
        now.append((x, P))
    smooth = [now[-1]]
    for (x, P), (A, Q, x_ahead, P_ahead, lost) in zip(now[-2::-1], ahead[:0:-1], strict=True):
        if lost:
            smooth.append((x, P))
            continue
        gain = np.linalg.solve(P_ahead, A @ P).T
        keep = np.eye(3) - gain @ A
        x_next, P_next = smooth[-1]
        smooth.append((x + gain @ (x_next - x_ahead), keep @ P @ keep.T + gain @ (Q + P_next) @ gain.T))
    return tuple(map(np.array, zip(*smooth[::-1], strict=True)))


def by_the_textbook(params, log, left_out, variance=None):
    """Bias and drift (T, 2, 6) with standard deviations, from smoothed joints and ``bias_filter.step``."""
    dt = np.diff(log.t, prepend=log.t[0])
    joint = params.joint
    densities = zip(joint.process_density, joint.position_std, joint.velocity_std, strict=True)
    joints = [
        textbook_joints((*map(float, noise), np.asarray(joint.prior_std)), dt, log.q[:, j], log.dq[:, j])
        for j, noise in enumerate(densities)
    ]
    mean, covariance = (jnp.asarray(np.stack(x, 1)) for x in zip(*joints, strict=True))
    wrench = jnp.asarray(np.where(left_out[:, None], np.nan, log.wrench))

    def step(state, sample):
        dt, mean, covariance, wrench = sample
        motion, wrench_tool = predict_wrench(params, mean)
        G = joint_sensitivity(params.theta, motion.R_base_sensor, motion.jacobian, params.gravity)
        R = jnp.diag(params.bias.wrench_variance + jnp.diagonal(covariance_of_joints(G, covariance)))
        shaking = bias_filter.vibration(params.bias, mean[:, 1])
        R = R if shaking is None else R + jnp.diag(shaking)
        state, _ = bias_filter.step(params.bias, state, dt, wrench_tool, wrench, R, GATE)
        return state, (state.mean[:12], jnp.sqrt(jnp.diagonal(state.covariance)[:12]))

    found = jax.lax.scan(step, bias_filter.init(params.bias), (jnp.asarray(dt), mean, covariance, wrench))[1]
    return tuple(np.asarray(x).reshape(-1, 2, 6) for x in found)


def assert_textbook(result, log, left_out):
    mean, std = by_the_textbook(result.params, log, left_out)
    rows = np.isfinite(log.wrench).any(1)
    inflation = result.noise.inflation
    got = ((result.bias, result.drift), (result.bias_std / inflation, result.drift_std / inflation))
    for values, expected in zip(got, (mean, std), strict=True):
        for one, other in zip(values, np.moveaxis(expected[rows], 1, 0), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(other).max())


def test_the_parameters_of_a_result_reproduce_it_by_the_textbook(setup, made):
    """The log has contact, slow errors and vibration, all of which are in its parameters and contacts."""
    log, _ = made
    rng = np.random.default_rng(5)
    std, inside = np.repeat([0.1, 0.004], 3), (log.t >= 12.3) & (log.t < 13.9)
    shaking = 3 * np.abs(log.dq).sum(1)[:, None] * std * rng.normal(size=log.wrench.shape)
    changed = with_wrench(log, gauss_markov(rng, log.t, 2 * std, 0.5) + shaking - inside[:, None] * 3 * FORCE)
    result = ft.filter_log(setup, changed)
    assert len(result.contacts) == 1
    assert result.params.bias.vibration is not None
    assert result.params.bias.correlated_std is not None
    touched = ~result.used & (result.t > 12) & (result.t < 14.2)
    assert_textbook(result, changed, touched)


@pytest.mark.slow
def test_a_recorded_log_is_reproduced_by_the_textbook_too(shared_data):
    setup = load_setup(shared_data / "real" / "abb_frida.toml")
    log = read_log(shared_data / "real" / "abb_frida.npz", setup)
    result = ft.filter_log(setup, log, unchecked=True)
    assert result.contacts == ()
    assert_textbook(result, log, np.zeros(len(log.t), bool))


def test_logs_are_mapped_over_and_each_is_as_alone(likeliest, made):
    """Padding and contact of one log change nothing in the other."""
    log, _ = made
    pushed = with_wrench(log, ((log.t >= 12.3) & (log.t < 13.9))[:, None] * -FORCE)
    one, two = (samples_of(likeliest, each) for each in (log, pushed))
    layout = layout_of(one.dt)
    both = jax.tree.map(lambda x, y: jnp.stack([x, y]), one, two)
    params, states, infos = jax.jit(jax.vmap(lambda samples: filter_samples(likeliest, samples, layout=layout)))(both)
    for i, samples in enumerate((one, two)):
        alone = filter_samples(likeliest, samples, layout=layout)
        for got, expected in zip(jax.tree.leaves((params, states, infos)), jax.tree.leaves(alone), strict=True):
            np.testing.assert_allclose(got[i], expected, rtol=1e-9, atol=1e-12)
    assert not infos.noise.contacts.inside[0].any()
    assert infos.noise.contacts.inside[1].any()


def test_every_gradient_is_finite(likeliest, made):
    """The derivative of all outputs with respect to every parameter, with contact and slow errors in the log."""
    log, _ = made
    slow = gauss_markov(np.random.default_rng(1), log.t, np.repeat([0.3, 0.012], 3), 0.5)
    pushed = with_wrench(log, slow + ((log.t >= 12.3) & (log.t < 13.9))[:, None] * -FORCE)
    samples = samples_of(likeliest, pushed)
    layout = layout_of(samples.dt)

    def total(params):
        found = filter_samples(params, samples, layout=layout)
        reals = [x for x in jax.tree.leaves(found) if jnp.issubdtype(x.dtype, jnp.floating)]
        return sum(jnp.where(jnp.isfinite(x), x, 0).sum() for x in reals)

    slopes = jax.grad(total)(likeliest)
    for path, slope in jax.tree.leaves_with_path(slopes):
        assert np.isfinite(slope).all(), path


def test_the_gradient_of_the_likelihood_is_that_of_differences(likeliest, made):
    """The noise is as stated, so that no estimate from the log is held constant."""
    log, _ = made
    log = log._replace(**{name: getattr(log, name)[:700] for name in ("t", "q", "dq", "wrench", "temperature")})
    samples = samples_of(likeliest, log)
    layout, method = layout_of(samples.dt), ("smooth_joints", "filter_bias")

    def nats(log_variance):
        bias = likeliest.bias._replace(wrench_variance=likeliest.bias.wrench_variance * jnp.exp(log_variance))
        params = likeliest._replace(bias=bias)
        return filter_samples(params, samples, method=method, layout=layout)[2].log_likelihood

    at = jnp.linspace(-0.2, 0.3, 6)
    slope = np.asarray(jax.grad(nats)(at))
    for axis in range(6):
        step = 1e-4 * np.eye(6)[axis]
        assert slope[axis] == pytest.approx(float(nats(at + step) - nats(at - step)) / 2e-4, rel=1e-5)


def test_single_precision_is_close(likeliest, made):
    narrow = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), likeliest)
    log, _ = made
    one, other = (by_params.found_in(params, log, method=METHOD) for params in (narrow, likeliest))
    assert one[1].bias.dtype == np.float32
    rows = slice(RATE, len(log.t))
    error = np.abs(one[1].bias[rows] - other[1].bias[rows]) / other[1].bias_std[rows]
    assert error.max() < 0.2
    np.testing.assert_allclose(one[1].bias_std[rows], other[1].bias_std[rows], rtol=0.02)


def test_a_program_must_be_given_the_layout(likeliest, made):
    samples = samples_of(likeliest, made[0])
    with pytest.raises(UsageError, match="layout"):
        jax.jit(lambda samples: filter_samples(likeliest, samples, method=AS_STATED))(samples)


def test_a_log_too_short_for_blocks_is_filtered_with_what_is_stated(setup, made):
    log, _ = made
    short = log._replace(**{name: getattr(log, name)[:300] for name in ("t", "q", "dq", "wrench", "temperature")})
    found, result = filtered(setup, short, smooth=True)
    assert found.noise.vibration is None
    assert np.isfinite(result.bias).all()
    assert (result.bias_smooth_std <= result.bias_std * (1 + 1e-9)).all()


def test_what_effects_add_to_the_bias_is_in_the_smoothed_one_too(setup, made):
    """The setup states that the sensor warms up by some newtons."""
    log, _ = made
    amplitude = np.array([4.0, -2, 1, 0.2, 0.1, -0.1])
    warm = parse_setup({**YAW_PITCH_ROLL, "effects": {"warmup": {"amplitude": list(amplitude), "tau": 5.0}}})
    known = (1 - np.exp(-log.t / 5.0))[:, None] * amplitude
    (_, plain), (_, result) = filtered(setup, log), filtered(warm, with_wrench(log, -known), smooth=True)
    np.testing.assert_allclose(result.bias - plain.bias, known, atol=1e-6)
    error = result.bias_smooth - result.bias
    assert (np.abs(error[RATE:]) < 5 * result.bias_std[RATE:]).all()
