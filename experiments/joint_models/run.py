"""Error of the acceleration estimated by the report's three joint models, each with its maximum-likelihood noise."""

import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

sys.path.append(str(Path(__file__).parents[1]))
from common import MOTIONS, PARAMS, keep, rounded, simulate_logs

from ftbias_jax.calibration import tune
from ftbias_jax.calibration.noise.values import JOINT_NAMES
from ftbias_jax.filtering import pipeline, smoother
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.fast.scan import filter_scan
from ftbias_jax.filtering.likelihood import joint_log_likelihood
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.process_models import JOINT_MODELS

RATES = [500.0, 100.0]
SECONDS = 12.0
"""Length of each of two logs: one to tune the noise on, one to score on."""
SETTLED = 1.0
COLORS = dict(zip(JOINT_MODELS, ("#0072B2", "#D55E00", "#009E73"), strict=True))


def accelerations(params, log, model):
    """Filtered and smoothed joint accelerations, (T, n) each."""
    start = pipeline.init(params, log)
    track = filter_scan(JOINT_MODELS[model], stages.joint_inputs(params.joint, start.joint, log))
    smoothed = smoother.smooth_joints(params, start, log, Options(joint_model=model))
    return track.mean[:, 2], smoothed.mean[:, :, 2]


def compare(motion, rate):
    """Scores of each model for one motion at one rate, and the acceleration of one joint to plot."""
    t = jnp.arange(round(SECONDS * rate)) / rate
    trajectories = jax.tree.map(lambda *x: jnp.stack(x), *(motion(seed, t) for seed in (0, 1)))
    _, logs = simulate_logs(0, 2, PARAMS, trajectories)
    learning, unseen = (jax.tree.map(lambda x, i=i: x[i], logs) for i in (0, 1))
    truth = np.asarray(trajectories.ddq[1])
    rows = slice(round(SETTLED * rate), None)
    scores, shown = {}, {"t": np.asarray(t), "truth": truth[:, 1]}
    for model in JOINT_MODELS:
        options = Options(joint_model=model)
        params, fit = tune.tune_joints(PARAMS, [learning], dict.fromkeys(JOINT_NAMES, "each"), options)
        filtered, smoothed = map(np.asarray, jax.jit(accelerations, static_argnums=2)(params, unseen, model))
        scores[model] = {
            "density_median": rounded(np.median(params.joint.process_density)),
            "position_std_median": rounded(np.median(params.joint.position_std)),
            "velocity_std_median": rounded(np.median(params.joint.velocity_std)),
            "converged": fit.optimum.converged,
            "held_out_nats_per_sample": rounded(
                joint_log_likelihood(params, unseen, options, SETTLED) / (len(truth) - rows.start)
            ),
            "filtered_rms_error": rounded(rms(filtered[rows] - truth[rows])),
            "smoothed_rms_error": rounded(rms(smoothed[rows] - truth[rows])),
        }
        shown[model] = filtered[:, 1]
    motion_itself = rounded(rms(truth[rows]))
    return {"rms_of_the_motion": motion_itself, "models": scores}, shown


def rms(x):
    return np.sqrt((x**2).mean())


def main():
    result = {"seconds": SECONDS, "units": "rad/s^2", "cases": {}}
    for name, motion in MOTIONS.items():
        for rate in RATES:
            result["cases"][f"{name} at {rate:g} Hz"], shown = compare(motion, rate)
    keep(__file__, result, draw(result, shown))


def draw(result, shown):
    """Plot bars of all cases, and three seconds of the last case."""
    figure = Figure(figsize=(10, 3.8), layout="constrained")
    bars, lines = figure.subplots(1, 2)
    for i, (model, color) in enumerate(COLORS.items()):
        errors = [case["models"][model]["filtered_rms_error"] for case in result["cases"].values()]
        bars.bar(np.arange(len(errors)) + 0.27 * (i - 1), errors, 0.25, color=color, label=model)
    bars.set(title="error of the acceleration, rms", ylabel="rad/s$^2$", yscale="log")
    bars.set_xticks(range(len(errors)), [name.replace(" at ", "\n") for name in result["cases"]])
    bars.set_ylim(top=5)
    bars.legend(fontsize=8)
    rows = (shown["t"] >= 5) & (shown["t"] < 8)
    for name, values in shown.items():
        if name != "t":
            lines.plot(shown["t"][rows], values[rows], color=COLORS.get(name, "black"), linewidth=1.1, label=name)
    lines.set(title=f"joint 2, {list(result['cases'])[-1]}", xlabel="time [s]", ylabel="rad/s$^2$")
    lines.legend(fontsize=8)
    return figure


if __name__ == "__main__":
    main()
