"""Consistency of the bias's error bars on 200 simulated logs: true model, wrong models, and what the package uses."""

import sys
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

sys.path.append(str(Path(__file__).parents[1]))
from common import CENTER, PARAMS, SETUP, keep, rounded, simulate_logs, sines

from ftbias_jax.filtering import params_for_log, pipeline, smoother
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.fast.scan import filter_scan
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS
from ftbias_jax.filtering.process_models import JOINT_MODELS, drift_noise, integrated_jerk_noise
from ftbias_jax.filtering.quality.consistency import mean_chi_square
from ftbias_jax.model.simulate import Trajectory

LOGS, DURATION, RATE, SEED = 200, 60.0, 50.0, 0
AT_ONCE = 50
JERK = 0.1
"""rad/s^2.5, process noise density of joints that move as the joint filter's model assumes."""
START = np.array([1.0, 0.1, 0.5])
"""rad, rad/s, rad/s^2: prior standard deviations of those joints, from which velocity and acceleration are drawn."""
MODELS = {
    "true": (1.0, 1.0),
    "sigma_Q x 2": (2.0, 1.0),
    "sigma_Q / 2": (0.5, 1.0),
    "Sigma_W x 1.5": (1.0, 1.5),
    "Sigma_W / 1.5": (1.0, 1 / 1.5),
}
"""Factors on sigma_Q and on Sigma_W in the filter's model."""

COLORS = ["#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7"] * 2
STYLES = ["-"] * 5 + ["--"] * 5


def squares(track, bias, drift):
    """NEES of the twelve states and NIS of the six axes at every sample, (T,) each."""
    error = track.mean - jnp.stack([bias, drift], 1)
    (bb, bd), (_, dd) = jnp.moveaxis(track.covariance, 0, 2)
    eb, ed = error[:, 0], error[:, 1]
    nees = (dd * eb**2 - 2 * bd * eb * ed + bb * ed**2) / (bb * dd - bd**2)
    return nees.sum(1), track.nis.sum(1)


@jax.jit
def known_joints(factors, samples, truth):
    """Run the bias filter alone, with the wrench of the tool known exactly."""
    bias = PARAMS.bias._replace(
        density=factors[0] * PARAMS.bias.density, wrench_variance=factors[1] * PARAMS.bias.wrench_variance
    )
    params = PARAMS._replace(bias=bias)

    def one(log, truth):
        variance = jnp.broadcast_to(bias.wrench_variance, truth.bias.shape)
        inputs = stages.bias_inputs(params, pipeline.init(params, log), log, truth.wrench_tool, variance)
        return squares(filter_scan(drift_noise, inputs), truth.bias, truth.drift)

    return jax.lax.map(lambda log: one(*log), (samples, truth), batch_size=AT_ONCE)


@partial(jax.jit, static_argnames="smoothed")
def whole_pipeline(params, samples, truth, smoothed=False):
    """Filter or smooth the joints, then filter the bias."""

    def one(log, truth):
        start = pipeline.init(params, log)
        if smoothed:
            joints = smoother.smooth_joints(params, start, log)
        else:
            inputs = stages.joint_inputs(params.joint, start.joint, log)
            joints = stages.joint_states(filter_scan(JOINT_MODELS[DEFAULT_OPTIONS.joint_model], inputs))
        wrench_tool, variance = stages.predict_wrenches(params, joints, log, DEFAULT_OPTIONS)
        track = filter_scan(drift_noise, stages.bias_inputs(params, start, log, wrench_tool, variance))
        return squares(track, truth.bias, truth.drift)

    return jax.lax.map(lambda log: one(*log), (samples, truth), batch_size=AT_ONCE)


def white_jerk(t):
    """Random trajectories (logs, T, n) of the joint filter's own model, with a weak pull that keeps them bounded."""
    rng, dt = np.random.default_rng(SEED), 1 / RATE
    A, Q = (np.array(rows, float) for rows in integrated_jerk_noise(jnp.array(dt), jnp.array(JERK)))
    root = np.linalg.cholesky(Q).T
    state = rng.normal(size=(LOGS, 7, 3)) * START * [0, 1, 1]
    states = [state]
    for _ in t[1:]:
        state = state @ A.T + rng.normal(size=state.shape) @ root
        state[..., 2] -= dt * state @ [0.02, 0.15, 0.6]
        states.append(state)
    q, dq, ddq = jnp.moveaxis(jnp.asarray(np.stack(states, 1)), -1, 0)
    return Trajectory(jnp.broadcast_to(t, q.shape[:2]), q + CENTER, dq, ddq)


def judge(nees, nis):
    """Compare final NEES, for which the logs are independent draws, and NIS of all samples with their 95 % bounds."""
    scored = {}
    for name, values, dof in (("nees", nees[:, -1], 12), ("nis", nis.ravel(), 6)):
        average = mean_chi_square(values, dof)
        bounds = rounded([average.low, average.high], 6)
        scored[name] = {"mean": rounded(average.value, 6), "bounds": bounds, "inside": average.consistent}
    return scored


def main():
    t = jnp.arange(round(DURATION * RATE)) / RATE
    trajectory = sines(SEED, t)
    trajectories = jax.tree.map(lambda x: jnp.broadcast_to(x, (LOGS, *x.shape)), trajectory)
    truth, samples = simulate_logs(SEED, LOGS, PARAMS, trajectories)
    result = {"logs": LOGS, "seconds": DURATION, "rate_Hz": RATE, "models": {}}
    over_time = {}
    runs = {name: partial(known_joints, jnp.array(factors), samples, truth) for name, factors in MODELS.items()}
    likeliest = params_for_log.max_likelihood_params(SETUP, jax.tree.map(lambda x: x[0], samples))
    guarded = params_for_log.guard_against_lag(likeliest)
    by_model = PARAMS._replace(joint=PARAMS.joint._replace(process_density=jnp.full(7, JERK), prior_std=START))
    jerky = simulate_logs(SEED, LOGS, PARAMS, white_jerk(t))[::-1]
    runs["white jerk: true, joints filtered"] = partial(whole_pipeline, by_model, *jerky)
    runs["white jerk: true, joints smoothed"] = partial(whole_pipeline, by_model, *jerky, smoothed=True)
    runs["sines: likeliest, joints filtered"] = partial(whole_pipeline, likeliest, samples, truth)
    runs["sines: likeliest x 8, as ftbias filter"] = partial(whole_pipeline, guarded, samples, truth)
    runs["sines: likeliest, joints smoothed"] = partial(whole_pipeline, likeliest, samples, truth, smoothed=True)
    for name, run in runs.items():
        nees, nis = map(np.asarray, run())
        result["models"][name] = judge(nees, nis)
        over_time[name] = nees.mean(0)
    keep(__file__, result, draw(result, np.asarray(t), over_time))


def draw(result, t, over_time):
    figure = Figure(figsize=(10, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    low, high = result["models"]["true"]["nees"]["bounds"]
    left.axhspan(low, high, color="0.85", label="95 % of right models")
    for name, values in over_time.items():
        left.plot(t, values, linewidth=1, label=name, color=COLORS[len(left.lines)], linestyle=STYLES[len(left.lines)])
    left.set(title="NEES of bias and drift", xlabel="time [s]", yscale="log")
    left.legend(fontsize=6, ncols=2, loc="upper left")
    left.set_ylim(top=300)
    names = list(result["models"])
    right.axvspan(*result["models"]["true"]["nis"]["bounds"], color="0.85")
    for row, scored in enumerate(result["models"].values()):
        right.plot(scored["nis"]["mean"], row, "o" if scored["nis"]["inside"] else "x", color="#0072B2")
    right.set_yticks(range(len(names)), names, fontsize=7)
    right.set(title="NIS of six axes: o inside its bounds, x outside")
    right.grid(color="0.9")
    return figure


if __name__ == "__main__":
    main()
