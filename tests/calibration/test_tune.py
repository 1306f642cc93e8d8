"""Noise parameters found again in simulated logs of the filter's own model."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.calibration import newton, tune
from ftbias_jax.calibration.noise.score import WrenchLogs, WrenchScore
from ftbias_jax.calibration.noise.values import JOINT_NAMES, TIES, WRENCH_NAMES
from ftbias_jax.calibration.tune import stack
from ftbias_jax.filtering.likelihood import joint_log_likelihood, wrench_given_joints
from ftbias_jax.model import simulate
from ftbias_jax.types import Sample

DT = 0.01
STATES = np.array([[1, DT, DT**2 / 2], [0, 1, DT], [0, 0, 1]])
JERK = np.linalg.cholesky(
    [[DT**5 / 20, DT**4 / 8, DT**3 / 6], [DT**4 / 8, DT**3 / 3, DT**2 / 2], [DT**3 / 6, DT**2 / 2, DT]]
)
ALL_JOINT_NOISE = dict.fromkeys(JOINT_NAMES, "each")
ALL_WRENCH_NOISE = dict.fromkeys(WRENCH_NAMES, "each")
ROWS = (("density", tuple(range(6))), ("wrench_std", tuple(range(6, 12))))


@pytest.fixture(scope="module")
def truth(params):
    """The small arm moving gently, and a bias that moves within a second."""
    joint = params.joint._replace(process_density=jnp.array([0.3, 0.5, 0.2]))
    bias = params.bias._replace(
        density=jnp.array([0.03, 0.04, 0.05, 2e-3, 3e-3, 4e-3]),
        data_variance=None,
        wrench_variance=jnp.array([0.2, 0.3, 0.4, 0.01, 0.02, 0.03]) ** 2,
    )
    return params._replace(joint=joint, bias=bias)


def motions(seeds, count, density):
    """Joint motion (seeds, T, n, 3) by white noise on the jerk, with a weak pull that keeps it bounded."""
    rng = np.random.default_rng(seeds)
    noise = rng.normal(size=(count, len(seeds), len(density), 3)) @ JERK.T * np.asarray(density)[:, None]
    states = [np.zeros(noise.shape[1:])]
    for shock in noise[1:]:
        states.append(states[-1] @ STATES.T + shock)
        states[-1][..., 2] -= DT * states[-1] @ [0.02, 0.15, 0.6]
    return np.stack(states, 1)


@jax.jit
def simulated(truth, keys, motion):
    """Logs with a leading axis of seeds."""
    t = DT * jnp.arange(motion.shape[1])

    def one(key, motion):
        log = simulate.simulate(key, truth, simulate.Trajectory(t, *jnp.moveaxis(motion, -1, 0)))
        return Sample(jnp.diff(t, prepend=t[:1]), log.q, log.dq, log.wrench)

    return jax.vmap(one)(keys, motion)


def logs_of(truth, seeds, count):
    motion = motions(seeds, count, truth.joint.process_density)
    logs = simulated(truth, jax.vmap(jax.random.key)(jnp.array(seeds)), motion)
    return [jax.tree.map(lambda x, i=i: np.asarray(x[i]), logs) for i in range(len(seeds))]


def as_one_robot(truth, logs):
    """Joints are independent, so those of many logs are tuned as the joints of one robot."""
    many = {name: jnp.tile(getattr(truth.joint, name), len(logs)) for name in JOINT_NAMES}
    q, dq = (np.concatenate([getattr(log, name) for log in logs], 1) for name in ("q", "dq"))
    log = Sample(logs[0].dt, q, dq, logs[0].wrench)
    return truth._replace(joint=truth.joint._replace(**many)), log


def wrong(params, factor):
    """All noise parameters wrong by a factor."""
    joint = {name: factor * getattr(params.joint, name) for name in JOINT_NAMES}
    bias = {"density": factor * params.bias.density, "wrench_variance": factor**2 * params.bias.wrench_variance}
    return params._replace(joint=params.joint._replace(**joint), bias=params.bias._replace(**bias))


def pieces_of(log):
    """The log cut into equal pieces that count as separate logs, as in the tuning of joints."""
    count = -(-len(log.dt) // tune.PIECE)
    ends = np.arange(count + 1) * len(log.dt) // count
    for start, end in itertools.pairwise(ends):
        piece = Sample(*(x[start:end] for x in log[:4]))
        yield piece._replace(dt=np.r_[0.0, piece.dt[1:]])


def joint_truth(params):
    return {name: np.asarray(getattr(params.joint, name)) for name in JOINT_NAMES}


def wrench_truth(params):
    return {"density": np.asarray(params.bias.density), "wrench_std": np.sqrt(params.bias.wrench_variance)}


def misses(fit, truth):
    """Logarithm of the ratio of found to true values, and the same in standard errors, both flat."""
    error = {name: np.log(fit.values[name] / true) for name, true in truth.items()}
    in_sigmas = {name: error[name] / fit.relative_stderr[name] for name in truth}
    return np.concatenate(list(error.values())), np.concatenate(list(in_sigmas.values()))


def same(first, second):
    """Check that values agree to a hundredth of their standard errors."""
    return all(
        (np.abs(np.log(first.values[name] / second.values[name])) < 0.01 * first.relative_stderr[name]).all()
        for name in first.values
    )


def test_joint_noise_from_starts_wrong_by_thirty_either_way(truth):
    """The last joint has no velocities, so their noise is named as undetermined."""
    robot, log = as_one_robot(truth, logs_of(truth, [0, 1], 2000))
    log.dq[:, 5] = np.nan
    (high, fit), (_, other) = (
        tune.tune_joints(wrong(robot, factor), [log], ALL_JOINT_NOISE) for factor in (30.0, 1 / 30)
    )
    assert fit.optimum.converged
    assert same(fit, other)
    assert np.abs(misses(fit, joint_truth(robot))[1]).max() < 4
    np.testing.assert_array_equal(np.isinf(fit.relative_stderr["velocity_std"]), [False] * 5 + [True])
    assert fit.undetermined == ["joints.velocity_noise_std[5] (not distinguishable from zero)"]
    tuned = joint_log_likelihood(high, log, burn_in=0.2)
    np.testing.assert_allclose(tuned, fit.optimum.value, atol=2 * newton.SMALL_GAIN)
    assert fit.optimum.value > joint_log_likelihood(robot, log, burn_in=0.2)


def test_bias_and_sensor_noise_from_starts_wrong_by_thirty_either_way(truth):
    logs = logs_of(truth, [0, 1], 2000)
    start = {factor: wrong(truth, factor)._replace(joint=truth.joint) for factor in (30.0, 1 / 30)}
    (high, fit), (_, other) = (tune.tune_wrench(start[factor], logs, ALL_WRENCH_NOISE) for factor in start)
    assert fit.optimum.converged
    assert fit.undetermined == []
    assert same(fit, other)
    assert np.abs(misses(fit, wrench_truth(truth))[1]).max() < 4
    tuned, true = (sum(wrench_given_joints(p, log, burn_in=1.0) for log in logs) for p in (high, truth))
    np.testing.assert_allclose(tuned, fit.optimum.value, atol=2 * newton.SMALL_GAIN)
    assert tuned > true
    assert high.joint is truth.joint


@pytest.mark.slow
def test_many_logs_are_worked_through_in_parts(truth, monkeypatch):
    """Three logs of unequal length, processed two at a time with one empty place, give the result of one batch."""
    logs = [
        jax.tree.map(lambda x, n=n: x[:n], log)
        for log, n in zip(logs_of(truth, [0, 1, 2], 800), (800, 500, 700), strict=True)
    ]
    whole = tune.tune_joints(truth, logs, ALL_JOINT_NOISE)[1], tune.tune_wrench(truth, logs, ALL_WRENCH_NOISE)[1]
    monkeypatch.setattr(tune, "PIECES_AT_ONCE", 2)
    monkeypatch.setattr(tune, "SAMPLES_AT_ONCE", 1600)
    parts = tune.tune_joints(truth, logs, ALL_JOINT_NOISE)[1], tune.tune_wrench(truth, logs, ALL_WRENCH_NOISE)[1]
    for one, other in zip(whole, parts, strict=True):
        assert other.optimum.converged
        assert same(one, other)
        np.testing.assert_allclose(one.optimum.value, other.optimum.value, atol=2 * newton.SMALL_GAIN)


@pytest.fixture(scope="module")
def still(truth):
    """A robot at rest with a weightless tool and irregular stamps: the wrench is minus the bias plus noise."""
    rng = np.random.default_rng(0)
    dt = np.r_[0.0, rng.uniform(0.005, 0.015, 1999)]
    density = jnp.repeat(jnp.array([0.05, 3e-3]), 3)
    variance = jnp.repeat(jnp.array([0.2, 0.02]), 3) ** 2
    params = truth._replace(bias=truth.bias._replace(density=density, wrench_variance=variance))
    start = np.asarray(params.bias.prior_mean + params.bias.prior_std * rng.normal(size=12))
    bias, _ = simulate.bias_process(jax.random.key(0), jnp.cumsum(dt), density, start[:6], start[6:])
    wrench = np.sqrt(variance) * rng.normal(size=(2000, 6)) - bias
    wrench = wrench.at[300:500, 1].set(np.nan)
    nothing = np.zeros((2000, 6))
    whole = WrenchLogs(stack([Sample(dt, nothing[:, :3], nothing[:, :3], wrench)]), *2 * [nothing[None]])
    return params, whole


@pytest.mark.parametrize(("tie", "free"), [("one", 1), ("pair", 2), ("each", 6)])
def test_tied_values_are_best_together(still, tie, free):
    """No common factor makes the measurements likelier, and more data per value reduce its standard error."""
    params = still[0]
    fit = tune.fit_wrench(wrong(params, 3.0), [still], {"density": tie, "wrench_std": "each"})[1]
    assert fit.optimum.converged
    density = fit.values["density"]
    assert len(set(density)) == free
    if tie != "one":  # the true noise of forces and torques differs
        assert (np.abs(np.log(density / params.bias.density)) < 4 * fit.relative_stderr["density"]).all()
        alone = tune.fit_wrench(params, [still], ALL_WRENCH_NOISE)[1].relative_stderr["density"]
        np.testing.assert_allclose(fit.relative_stderr["density"], alone * np.sqrt(free / 6), rtol=0.35)

    score = WrenchScore(ROWS)
    best = np.log([density, fit.values["wrench_std"]])
    for group in set(TIES[tie](6)):
        off = 0.02 * np.stack([TIES[tie](6) == group, np.zeros(6)])
        low, here, high = (float(score(jnp.asarray(best + k * off), still).sum()) for k in (-1, 0, 1))
        assert max(low, high) < here


def check_recovery(error, in_sigmas):
    """Both arguments have a row of logs for each parameter."""
    assert np.abs(np.median(error, 1)).max() < 0.1
    assert (np.abs(in_sigmas) < 3).mean() >= 0.95


@pytest.mark.slow
def test_twenty_logs_give_the_truth_back(truth):
    """The medians are within a tenth of the truth, and the truth within three standard errors."""
    logs = logs_of(truth, range(20), 6000)
    robot, log = as_one_robot(truth, logs)
    _, fit = tune.tune_joints(robot, [log], ALL_JOINT_NOISE)
    check_recovery(*(np.moveaxis(x.reshape(3, 20, 3), 1, 2).reshape(9, 20) for x in misses(fit, joint_truth(robot))))
    assert fit.optimum.value > sum(joint_log_likelihood(robot, piece, burn_in=0.2) for piece in pieces_of(log))
    errors, in_sigmas = [], []
    for log in logs:
        _, fit = tune.tune_wrench(truth, [log], ALL_WRENCH_NOISE)
        assert fit.optimum.value > wrench_given_joints(truth, log, burn_in=1.0)
        for kept, part in zip((errors, in_sigmas), misses(fit, wrench_truth(truth)), strict=True):
            kept.append(part)
    check_recovery(np.stack(errors, 1), np.stack(in_sigmas, 1))
