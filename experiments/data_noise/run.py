"""Accuracy of Sigma_D tuned on short logs of three tools, together with sigma_Q, Sigma_W and the joints' noise."""

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
from ftbias_jax.calibration.noise.fit import Tool, tune_data
from ftbias_jax.calibration.noise.values import JOINT_NAMES, KINDS, WRENCH_NAMES, with_noise
from ftbias_jax.filtering import process_models
from ftbias_jax.model import simulate
from ftbias_jax.model.wrench.tool_wrench import measurement_covariance, tool_parameters
from ftbias_jax.types import Sample

SAMPLES, RATE, SEEDS = 4_000, 200.0, 20
START = 3.0
"""Factor by which all noise is wrong at the start; Sigma_D starts unstated."""
DATA_NOISE = {
    "linear_acceleration": jnp.full(3, 0.3),
    "angular_acceleration": jnp.full(3, 4.0),
    "angular_velocity": jnp.full(3, 0.02),
    "gravity_direction": jnp.full(3, 0.01),
}
TOOLS = {
    "flange plate": (0.3, [0.0, 0.0, 0.02], [2e-4, 0, 0, 2e-4, 0, 3e-4]),
    "gripper": (0.9, [0.01, -0.005, 0.06], [2.5e-3, 0, 0, 2.2e-3, 0, 1.1e-3]),
    "bent welding torch": (1.5, [-0.06, 0.08, 0.15], [1.6e-2, 2e-3, 4e-3, 1.4e-2, -5e-3, 1e-2]),
}
STILL = PARAMS._replace(joint=PARAMS.joint._replace(process_density=jnp.full(7, 0.3)))
PLAIN = [STILL._replace(theta=tool_parameters(*map(jnp.asarray, tool))) for tool in TOOLS.values()]
TRUTH = [with_noise(params, DATA_NOISE) for params in PLAIN]
GRAVITY = float(jnp.linalg.norm(STILL.gravity))


def white_jerk(rng):
    """Random joint states (T, n, 3) of the filter's own model, with a weak pull that keeps them bounded."""
    dt, density = 1 / RATE, float(STILL.joint.process_density[0])
    A, Q = (np.array(rows, float) for rows in process_models.integrated_jerk_noise(jnp.array(dt), jnp.array(density)))
    shocks = rng.normal(size=(SAMPLES, 7, 3)) @ np.linalg.cholesky(Q).T
    states = np.zeros((SAMPLES, 7, 3))
    for i in range(1, SAMPLES):
        states[i] = states[i - 1] @ A.T + shocks[i]
        states[i, :, 2] -= dt * states[i] @ [0.02, 0.15, 0.6]
    return states + CENTER[:, None] * np.array([1, 0, 0])


def make_log(params, seed):
    t = jnp.arange(SAMPLES) / RATE
    q, dq, ddq = (jnp.asarray(x) for x in np.moveaxis(white_jerk(np.random.default_rng(seed)), 2, 0))
    made = simulate.simulate(jax.random.key(seed), params, simulate.Trajectory(t, q, dq, ddq))
    return jax.tree.map(np.asarray, Sample(jnp.diff(t, prepend=t[:1]), made.q, made.dq, made.wrench))


def wrong(params):
    joint = params.joint._replace(**{name: START * getattr(params.joint, name) for name in JOINT_NAMES})
    density, variance = START * params.bias.density, START**2 * params.bias.wrench_variance
    bias = params.bias._replace(density=density, wrench_variance=variance, data_variance=None)
    return params._replace(joint=joint, bias=bias)


def tune_all(logs, kind):
    """Tune the noise of the joints, then all noise of the wrench together."""
    tuned, joints = tune.tune_joints(wrong(PLAIN[0]), logs, dict.fromkeys(JOINT_NAMES, "each"))
    tools = [Tool(wrong(params)._replace(joint=tuned.joint), [log]) for params, log in zip(PLAIN, logs, strict=True)]
    return joints, *tune_data(tools, KINDS[kind] | dict.fromkeys(WRENCH_NAMES, "each"))


def misses(fit, truth):
    """Errors of the logarithms of the values that the fit determines, in standard errors."""
    found = {}
    for name, true in truth.items():
        error = np.log(fit.values[name] / np.asarray(true)) / fit.relative_stderr[name]
        found[name] = error[np.isfinite(fit.relative_stderr[name])]
    return found


def force_miss(fit):
    """Ratio to the truth and error in standard errors of the noise of a - g, of acceleration and gravity together."""
    words = next(words for words in fit.determined if words.startswith("a - g"))
    value, error = (float(x) for x in words.split("s = ")[1].removesuffix(" m/s^2").split(" ± "))
    true = np.hypot(0.3, 0.01 * GRAVITY)
    return value / true, (value - true) / error


def variances(tools):
    """Diagonal of the measurement covariance R of every tool, (S, 6)."""
    return np.stack(
        [np.diagonal(measurement_covariance(p.theta, p.bias.data_variance, p.bias.wrench_variance)) for p in tools]
    )


def main():
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS
    wrench_truth = {"density": STILL.bias.density, "wrench_std": jnp.sqrt(STILL.bias.wrench_variance)}
    joint_truth = {name: getattr(STILL.joint, name) for name in JOINT_NAMES}
    sigmas, values, totals, seconds, open_words = {}, {}, [], [], {}
    for seed in range(seeds):
        logs = [make_log(params, 100 * seed + number) for number, params in enumerate(TRUTH)]
        begin = time.perf_counter()
        joints, fitted, fit = tune_all(logs, "one")
        seconds.append(time.perf_counter() - begin)
        found = misses(fit, wrench_truth | DATA_NOISE) | misses(joints, joint_truth)
        ratio, off = force_miss(fit)
        found["a - g"] = np.array([off])
        for name, error in found.items():
            once = error[:1] if name in DATA_NOISE else error
            sigmas.setdefault(name, []).append(once)
        values.setdefault("a - g", []).append([ratio])
        for name, true in (wrench_truth | DATA_NOISE).items():
            known = np.isfinite(fit.relative_stderr[name])
            values.setdefault(name, []).append(np.where(known, fit.values[name] / true, np.nan))
        totals.append(np.sqrt(variances(fitted) / variances(TRUTH)))
        for words in fit.undetermined:
            open_words[words] = open_words.get(words, 0) + 1
        print(f"seed {seed}: {seconds[-1]:.1f} s, {fit.optimum.converged}, {fit.undetermined}", flush=True)
    _, one_tool = tune_data(
        [Tool(TRUTH[1]._replace(bias=PLAIN[1].bias), [logs[1]])], KINDS["one"] | {"wrench_std": "each"}
    )
    result = {
        "samples": SAMPLES,
        "seeds": seeds,
        "seconds, median, first": [rounded(np.median(seconds)), rounded(seconds[0])],
        "share within 3 standard errors, of how many": {
            name: [rounded((np.abs(np.concatenate(error)) < 3).mean()), len(np.concatenate(error))]
            for name, error in sigmas.items()
            if len(np.concatenate(error))
        },
        "median over truth": {
            name: rounded(np.nanmedian(np.stack(value))) for name, value in values.items() if np.isfinite(value).any()
        },
        "noise of the reading over truth, least and largest": rounded([np.min(totals), np.max(totals)]),
        "undetermined, in how many of the fits": open_words,
        "one tool, undetermined": one_tool.undetermined,
        "one tool, determined": one_tool.determined,
    }
    keep(__file__, result, draw(values, np.stack(totals)))


def draw(values, totals):
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 4))
    rng = np.random.default_rng(0)
    shown = {
        "density": "sigma_Q",
        "wrench_std": "Sigma_W",
        "a - g": "a - g",
        "angular_acceleration": "angular\nacceleration",
    }
    for place, name in enumerate(shown):
        ratio = np.stack(values[name])
        ratio = ratio[:, :1] if name in DATA_NOISE else ratio
        left.plot(place + rng.uniform(-0.3, 0.3, ratio.shape), ratio, ".", color="#0072B2", markersize=4)
    left.set_xticks(range(len(shown)), list(shown.values()))
    left.set(ylabel="tuned / true", title=f"what three tools determine, {SEEDS} seeds")
    for number, (tool, color) in enumerate(zip(TOOLS, ("#D55E00", "#009E73", "#CC79A7"), strict=True)):
        places = np.arange(6) + 0.25 * (number - 1) + rng.uniform(-0.05, 0.05, totals[:, number].shape)
        right.plot(places, totals[:, number], ".", color=color, markersize=4)
        right.plot([], [], "o", color=color, label=tool)
    right.set_xticks(range(6), ["fx", "fy", "fz", "tx", "ty", "tz"])
    right.set(ylabel="tuned / true", title="standard deviation of the reading, sqrt(R)")
    right.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.07), ncols=3, frameon=False)
    for axes in (left, right):
        axes.axhline(1, color="black", linewidth=0.8)
    return figure


if __name__ == "__main__":
    main()
