"""By which factor the joints' process noise should exceed its maximum-likelihood value, for the smallest bias error."""

import sys
from pathlib import Path

import jax
import jax.numpy as jnp
from matplotlib.figure import Figure

sys.path.append(str(Path(__file__).parents[1]))
from common import MOTIONS, PARAMS, keep, rounded, simulate_logs

from ftbias_jax.filtering import pipeline
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.fast.scan import filter_scan
from ftbias_jax.filtering.params_for_log import max_likelihood_density
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS
from ftbias_jax.filtering.process_models import drift_noise

FACTORS = [1, 2, 4, 8, 16, 32]
LOGS, DURATION, RATE, SETTLED = 8, 30.0, 250.0, 5.0


@jax.jit
def likeliest(samples):
    return jax.vmap(lambda log: max_likelihood_density(PARAMS.joint, log.dt, log.q, log.dq))(samples)


@jax.jit
def errors(densities, samples, truth):
    """Error of the bias and its standard deviation, (logs, T, 6) each."""

    def one(density, log, bias):
        params = PARAMS._replace(joint=PARAMS.joint._replace(process_density=density))
        _, track = stages.run(params, pipeline.init(params, log), log, DEFAULT_OPTIONS)
        return track.wrench.mean[:, 0] - bias, jnp.sqrt(track.wrench.covariance[:, 0, 0])

    return jax.vmap(one)(densities, samples, truth.bias)


@jax.jit
def errors_of_known_joints(samples, truth):
    """Errors with the wrench of the tool known exactly, the lower bound for any choice of the joints' noise."""

    def one(log, wrench_tool, bias):
        variance = jnp.broadcast_to(PARAMS.bias.wrench_variance, wrench_tool.shape)
        inputs = stages.bias_inputs(PARAMS, pipeline.init(PARAMS, log), log, wrench_tool, variance)
        track = filter_scan(drift_noise, inputs)
        return track.mean[:, 0] - bias, jnp.sqrt(track.covariance[:, 0, 0])

    return jax.vmap(one)(samples, truth.wrench_tool, truth.bias)


def scores(error, std):
    """After the settling time: rms errors of force and torque, and shares of errors within 2 and 3 sigma."""
    first = round(SETTLED * RATE)
    error, inside = error[:, first:], jnp.abs(error / std)[:, first:]
    rms = jnp.sqrt((error**2).mean((0, 1)))
    return {
        "force_rmse_N": rounded(rms[:3].mean()),
        "torque_rmse_Nm": rounded(rms[3:].mean()),
        "inside_2_sigma": rounded((inside < 2).mean()),
        "inside_3_sigma": rounded((inside < 3).mean()),
    }


def main():
    t = jnp.arange(round(DURATION * RATE)) / RATE
    result = {
        "logs": LOGS,
        "seconds": DURATION,
        "rate_Hz": RATE,
        "settled_s": SETTLED,
        "factors": FACTORS,
        "motions": {},
    }
    for name, motion in MOTIONS.items():
        trajectories = jax.tree.map(lambda *x: jnp.stack(x), *(motion(seed, t) for seed in range(LOGS)))
        truth, samples = simulate_logs(0, LOGS, PARAMS, trajectories)
        best = likeliest(samples)
        result["motions"][name] = {
            "likeliest_density_median": rounded(jnp.median(best)),
            "known_joints": scores(*errors_of_known_joints(samples, truth)),
            "by_factor": [scores(*errors(factor * best, samples, truth)) for factor in FACTORS],
        }
    keep(__file__, result, draw(result))


def draw(result):
    figure = Figure(figsize=(10, 3.6), layout="constrained")
    for ax, (key, title) in zip(
        figure.subplots(1, 3),
        (
            ("force_rmse_N", "bias error of forces, rms [N]"),
            ("torque_rmse_Nm", "bias error of torques, rms [Nm]"),
            ("inside_2_sigma", "share of errors within 2 sigma"),
        ),
        strict=True,
    ):
        for color, marker, (name, scored) in zip(("#0072B2", "#D55E00"), "os", result["motions"].items(), strict=True):
            ax.plot(FACTORS, [s[key] for s in scored["by_factor"]], color=color, marker=marker, label=name)
        # One line serves both motions, because the motion does not matter when the joints are known.
        ax.axhline(scored["known_joints"][key], color="black", linestyle=":", label="joints known")
        ax.set_xscale("log", base=2)
        ax.set(title=title, xlabel="process noise / likeliest")
        ax.grid(color="0.9")
        if key != "inside_2_sigma":
            ax.set_ylim(bottom=0)
    ax.legend(loc="lower right")
    return figure


if __name__ == "__main__":
    main()
