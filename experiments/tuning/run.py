"""Noise tuning on a 60,000-sample log: do starts wrong by 30 times find the truth, and how long does it take?"""

import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

sys.path.append(str(Path(__file__).parents[1]))
from common import PARAMS, keep, rounded

from ftbias_jax import noise, simulate, tune
from ftbias_jax.commands import demo
from ftbias_jax.types import Sample

SAMPLES, RATE, SEED = 60_000, 500.0, 0
FACTORS = (30.0, 1 / 30.0)
TRUTH = PARAMS._replace(joint=PARAMS.joint._replace(process_density=jnp.ones(7)))


def white_jerk(rng):
    """(T, n, 3) joint states of the filter's own model, with a weak pull that keeps them bounded."""
    dt = 1 / RATE
    A, Q = (np.array(rows, float) for rows in noise.integrated_jerk_noise(jnp.array(dt), jnp.array(1.0)))
    shocks = rng.normal(size=(SAMPLES, 7, 3)) @ np.linalg.cholesky(Q).T
    states = np.zeros((SAMPLES, 7, 3))
    for i in range(1, SAMPLES):
        states[i] = states[i - 1] @ A.T + shocks[i]
        states[i, :, 2] -= dt * states[i] @ [0.02, 0.15, 0.6]
    return states + np.array(demo.CENTER)[:, None] * np.array([1, 0, 0])


def make_log():
    rng = np.random.default_rng(SEED)
    t = jnp.arange(SAMPLES) / RATE
    q, dq, ddq = (jnp.asarray(x) for x in np.moveaxis(white_jerk(rng), 2, 0))
    made = simulate.simulate(jax.random.key(SEED), TRUTH, simulate.Trajectory(t, q, dq, ddq))
    return Sample(jnp.diff(t, prepend=t[:1]), made.q, made.dq, made.wrench)


def wrong_by(factor):
    """Every noise parameter multiplied by a factor."""
    joint = TRUTH.joint._replace(**{name: factor * getattr(TRUTH.joint, name) for name in tune.JOINT_NAMES})
    bias = TRUTH.bias._replace(
        density=factor * TRUTH.bias.density, wrench_variance=factor**2 * TRUTH.bias.wrench_variance
    )
    return TRUTH._replace(joint=joint, bias=bias)


def run_once(log, factor):
    start = time.perf_counter()
    params, joints = tune.tune_joints(wrong_by(factor), [log], dict.fromkeys(tune.JOINT_NAMES, "each"))
    _, wrench = tune.tune_wrench(params, [log], dict.fromkeys(tune.WRENCH_NAMES, "each"))
    return joints, wrench, time.perf_counter() - start


def main():
    log = make_log()
    true = {name: np.asarray(getattr(TRUTH.joint, name)) for name in tune.JOINT_NAMES}
    true |= {"density": np.asarray(TRUTH.bias.density), "wrench_std": np.sqrt(np.asarray(TRUTH.bias.wrench_variance))}
    runs = {}
    figure = Figure(figsize=(8, 4), layout="constrained")
    axes = figure.subplots()
    for number, factor in enumerate(FACTORS):
        joints, wrench, seconds = run_once(log, factor)
        ratio = {name: fit.values[name] / true[name] for fit in (joints, wrench) for name in fit.values}
        stderr = {name: fit.relative_stderr[name] for fit in (joints, wrench) for name in fit.values}
        runs[f"start x {factor:.3g}"] = {
            "value over truth": {name: rounded(value) for name, value in ratio.items()},
            "relative standard error": {name: rounded(value, 2) for name, value in stderr.items()},
            "iterations": [joints.optimum.iterations, wrench.optimum.iterations],
            "converged": [joints.optimum.converged, wrench.optimum.converged],
            "log likelihood": [round(joints.optimum.value, 3), round(wrench.optimum.value, 3)],
        }
        print(f"start x {factor:.3g}: {seconds:.1f} s with compilation")
        place = np.concatenate([i + np.linspace(-0.3, 0.3, len(v)) for i, v in enumerate(ratio.values())])
        axes.errorbar(
            place + 0.03 * number,
            np.concatenate(list(ratio.values())),
            yerr=2 * np.concatenate(list(stderr.values())),
            fmt="os"[number],
            color=("#0072B2", "#D55E00")[number],
            markersize=4,
            label=f"start wrong by {factor:.3g}",
        )
    axes.axhline(1, color="black", linewidth=0.8)
    axes.set_xticks(range(len(true)), [name.replace("_", " ") for name in true])
    axes.set(ylabel="tuned / true, ± 2 standard errors", title=f"All noise parameters of a log of {SAMPLES} samples")
    axes.legend()
    keep(__file__, {"samples": SAMPLES, "seed": SEED, "runs": runs}, figure)


if __name__ == "__main__":
    main()
