"""Accuracy and speed of noise tuning on logs of 60,000 samples, also from starting values wrong by a factor of 30."""

import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

sys.path.append(str(Path(__file__).parents[1]))
from common import CENTER, PARAMS, keep, rounded

from ftbias_jax.calibration import tune
from ftbias_jax.calibration.noise.score import WrenchLogs
from ftbias_jax.calibration.noise.values import JOINT_NAMES, WRENCH_NAMES
from ftbias_jax.calibration.tune import stack
from ftbias_jax.filtering import pipeline, process_models
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.fast.scan import filter_scan
from ftbias_jax.filtering.likelihood import wrench_given_joints
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS
from ftbias_jax.filtering.process_models import JOINT_MODELS
from ftbias_jax.model import simulate
from ftbias_jax.types import Sample

SAMPLES, RATE, SEEDS = 60_000, 500.0, 20
FACTORS = (30.0, 1 / 30.0)
TRUTH = PARAMS._replace(joint=PARAMS.joint._replace(process_density=jnp.ones(7)))
JOINT_TIES = dict.fromkeys(JOINT_NAMES, "each")
WRENCH_TIES = dict.fromkeys(WRENCH_NAMES, "each")
KINDS = {"joints smoothed (what tune does)": "#0072B2", "joints filtered": "#D55E00", "joints known": "#009E73"}


def white_jerk(rng):
    """Random joint states (T, n, 3) of the filter's own model, with a weak pull that keeps them bounded."""
    dt = 1 / RATE
    A, Q = (np.array(rows, float) for rows in process_models.integrated_jerk_noise(jnp.array(dt), jnp.array(1.0)))
    shocks = rng.normal(size=(SAMPLES, 7, 3)) @ np.linalg.cholesky(Q).T
    states = np.zeros((SAMPLES, 7, 3))
    for i in range(1, SAMPLES):
        states[i] = states[i - 1] @ A.T + shocks[i]
        states[i, :, 2] -= dt * states[i] @ [0.02, 0.15, 0.6]
    return states + CENTER[:, None] * np.array([1, 0, 0])


def make_log(seed=0):
    """Simulate a log; return its samples and the true wrench of the tool (T, 6)."""
    t = jnp.arange(SAMPLES) / RATE
    q, dq, ddq = (jnp.asarray(x) for x in np.moveaxis(white_jerk(np.random.default_rng(seed)), 2, 0))
    made = simulate.simulate(jax.random.key(seed), TRUTH, simulate.Trajectory(t, q, dq, ddq))
    return Sample(jnp.diff(t, prepend=t[:1]), made.q, made.dq, made.wrench), made.wrench_tool


def wrong_by(factor):
    """Return the true parameters with every noise parameter multiplied by a factor."""
    joint = TRUTH.joint._replace(**{name: factor * getattr(TRUTH.joint, name) for name in JOINT_NAMES})
    bias = TRUTH.bias._replace(
        density=factor * TRUTH.bias.density, wrench_variance=factor**2 * TRUTH.bias.wrench_variance
    )
    return TRUTH._replace(joint=joint, bias=bias)


def tune_all(start, log):
    params, joints = tune.tune_joints(start, [log], JOINT_TIES)
    params, wrench = tune.tune_wrench(params, [log], WRENCH_TIES)
    return params, joints, wrench


@jax.jit
def filtered_wrench(params, log):
    """Wrench of the tool D theta from filtered joints, and its variance due to joint uncertainty, (T, 6) each."""
    track = filter_scan(
        JOINT_MODELS[DEFAULT_OPTIONS.joint_model],
        stages.joint_inputs(params.joint, pipeline.init(params, log).joint, log),
    )
    wrench_tool, variance = stages.predict_wrenches(params, stages.joint_states(track), log, DEFAULT_OPTIONS)
    return wrench_tool, variance - params.bias.wrench_variance[None]


def tune_given(params, log, wrench_tool, joint_variance):
    """Fit only the noise of the wrench, for a given wrench of the tool (T, 6) and its variance (T, 6)."""
    whole = WrenchLogs(stack([log]), wrench_tool[None], joint_variance[None])
    return tune.fit_wrench(params, [(params, whole)], WRENCH_TIES)[1]


def over_truth(true, *fits):
    """By name: ratio of the fitted to the true values, and the error of its logarithm in standard errors."""
    ratio = {name: fit.values[name] / true[name] for fit in fits for name in fit.values}
    stderr = {name: fit.relative_stderr[name] for fit in fits for name in fit.values}
    return ratio, {name: np.log(ratio[name]) / stderr[name] for name in ratio}


def from_wrong_starts(log, true):
    """Fitted over true values and log-likelihoods from each wrong start; prints the time."""
    runs = {}
    for factor in FACTORS:
        jax.clear_caches()
        begin = time.perf_counter()
        _, joints, wrench = tune_all(wrong_by(factor), log)
        print(f"start x {factor:.3g}: {time.perf_counter() - begin:.1f} s with compilation")
        runs[f"start x {factor:.3g}"] = {
            "value over truth": {name: rounded(value) for name, value in over_truth(true, joints, wrench)[0].items()},
            "converged": [joints.optimum.converged, wrench.optimum.converged],
            "log likelihood": [round(joints.optimum.value, 3), round(wrench.optimum.value, 3)],
        }
    return runs


def main():
    true = {name: np.asarray(getattr(TRUTH.joint, name)) for name in JOINT_NAMES}
    true |= {"density": np.asarray(TRUTH.bias.density), "wrench_std": np.sqrt(np.asarray(TRUTH.bias.wrench_variance))}
    result = {"samples": SAMPLES, "seeds": SEEDS, "wrong starts": from_wrong_starts(make_log()[0], true)}
    ratios = {kind: {} for kind in KINDS}
    in_sigmas, gains = {}, []
    for seed in range(SEEDS):
        log, wrench_tool = make_log(seed)
        params, joints, wrench = tune_all(TRUTH, log)
        gains.append(wrench.optimum.value - float(wrench_given_joints(params_at_truth(params), log, burn_in=1.0)))
        smoothed, *others = KINDS
        ratio, sigmas = over_truth(true, joints, wrench)
        fits = (
            tune_given(params, log, *filtered_wrench(params, log)),
            tune_given(params, log, wrench_tool, jnp.zeros_like(wrench_tool)),
        )
        for kind, found in zip((smoothed, *others), (ratio, *(over_truth(true, fit)[0] for fit in fits)), strict=True):
            for name, values in found.items():
                ratios[kind].setdefault(name, []).append(values)
        for name, values in sigmas.items():
            in_sigmas.setdefault(name, []).append(values)
        print(f"seed {seed}: sigma_Q over truth {np.round(ratio['density'], 2)}", flush=True)
    result["median over truth"] = {
        kind: {name: rounded(np.median(values, 0)) for name, values in found.items()} for kind, found in ratios.items()
    }
    result["share of truths within 3 standard errors"] = {
        name: rounded((np.abs(values) < 3).mean()) for name, values in in_sigmas.items()
    }
    result["least gain of the wrench's likelihood over that at truth [nats]"] = rounded(min(gains))
    keep(__file__, result, draw(ratios))


def params_at_truth(params):
    """Parameters with the true noise of bias and sensor, and the tuned noise of the joints."""
    return params._replace(bias=TRUTH.bias)


def draw(ratios):
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 4))
    place = {name: i for i, name in enumerate(ratios[next(iter(KINDS))])}
    rng = np.random.default_rng(0)
    for name, values in ratios[next(iter(KINDS))].items():
        values = np.ravel(values)
        left.plot(place[name] + rng.uniform(-0.3, 0.3, values.shape), values, ".", color="#0072B2", markersize=3)
    left.axhline(1, color="black", linewidth=0.8)
    left.set_xticks(range(len(place)), [name.replace("_", "\n") for name in place])
    left.set(ylabel="tuned / true", title=f"all 33 noise parameters, {SEEDS} logs")
    for number, (kind, color) in enumerate(KINDS.items()):
        values = np.array(ratios[kind]["density"])
        places = np.arange(6) + 0.25 * (number - 1)
        right.plot(places + np.zeros_like(values), values, ".", color=color, alpha=0.5, markersize=4)
        right.plot(places, np.median(values, 0), "_", color=color, markersize=14, markeredgewidth=2.5, label=kind)
    right.axhline(1, color="black", linewidth=0.8)
    right.set_xticks(range(6), ["fx", "fy", "fz", "tx", "ty", "tz"])
    right.set(ylabel="tuned / true", title="sigma_Q (bars: medians)")
    right.legend(fontsize=8)
    return figure


if __name__ == "__main__":
    main()
