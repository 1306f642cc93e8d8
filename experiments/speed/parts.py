"""Processor time of the noise model's parts (Sigma_D, vibration, gate, correlated noise) and the gradient; one core."""

import json
import os
import sys
import time
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})

import common
import jax
import jax.numpy as jnp
import numpy as np
from made_logs import PARAMS, make_log

from ftbias_jax.filtering import likelihood, pipeline
from ftbias_jax.filtering.fast import stages
from ftbias_jax.model.wrench.tool_wrench import DataNoise, data_variance

LENGTH, ROUNDS = 60_000, 7
GATED = pipeline.DEFAULT_OPTIONS._replace(gate=6.0)


def variants():
    """Name of the variant -> (parameters, options)."""
    bias, off = PARAMS.bias, pipeline.DEFAULT_OPTIONS
    std = jnp.sqrt(bias.wrench_variance)
    spread = DataNoise(*(jnp.full(3, x) for x in (0.05, 0.5, 0.02, 0.01)))
    sigma_d = {"data_variance": data_variance(spread, PARAMS.gravity)}
    shaken = {"vibration": jnp.broadcast_to(0.1 * bias.wrench_variance, (7, 6)), "vibration_speed": jnp.asarray(0.3)}
    slow = {"correlated_std": 0.5 * std, "correlated_time": jnp.full(6, 2.0)}

    def with_parts(**parts):
        return PARAMS._replace(bias=bias._replace(**parts))

    return {
        "all off": (PARAMS, off),
        "Sigma_D": (with_parts(**sigma_d), off),
        "vibration": (with_parts(**shaken), off),
        "robustness (gate)": (PARAMS, GATED),
        "Sigma_D, vibration and robustness": (with_parts(**sigma_d, **shaken), GATED),
        "correlated noise": (with_parts(**slow), off),
        "all together": (with_parts(**sigma_d, **shaken, **slow), GATED),
    }


def whole(params, samples, options):
    """Return the log-likelihood, and the mean of bias and drift at every sample."""
    _, track = stages.run(params, pipeline.init(params, samples), samples, options)
    return track.joint.log_likelihood.sum() + track.wrench.log_likelihood.sum(), track.wrench.mean


def score(params, samples, options):
    return likelihood.log_likelihood(params, samples, options)


def gradient(params, samples, options):
    """Log-likelihood and its gradient with respect to the noise of joints and bias."""

    def nats(joint, bias):
        return score(params._replace(joint=joint, bias=bias), samples, options)

    return jax.value_and_grad(nats, argnums=(0, 1))(params.joint, params.bias)


def compiled(function, params, samples, options):
    program = jax.jit(partial(function, options=options)).lower(params, samples).compile()
    return lambda: jax.block_until_ready(program(params, samples))


def main():
    samples = make_log(LENGTH)
    programs = {}
    for name, (params, options) in variants().items():
        for kind, function in (("filter", whole), ("likelihood", score)):
            programs[f"{kind}, {name}"] = compiled(function, params, samples, options)
    programs["gradient, all off"] = compiled(gradient, PARAMS, samples, pipeline.DEFAULT_OPTIONS)
    seconds = dict.fromkeys(programs, np.inf)
    for _ in range(ROUNDS + 1):  # the first round is a warm-up
        for name, program in programs.items():
            start = time.process_time()
            program()
            seconds[name] = min(seconds[name], time.process_time() - start)
    ratios = {}
    for kind in ("filter", "likelihood"):
        off = seconds[f"{kind}, all off"]
        ratios |= {name: x / off for name, x in seconds.items() if name.startswith(kind) and not name.endswith("off")}
    ratios["gradient / likelihood, all off"] = seconds["gradient, all off"] / seconds["likelihood, all off"]
    result = {"us_per_sample": {name: 1e6 * x / LENGTH for name, x in seconds.items()}, "ratios": ratios}
    result = jax.tree.map(lambda x: float(f"{x:.3g}"), result)
    print(json.dumps(result, indent=1))
    text = json.dumps({"versions": common.versions(), "result": result}, indent=1) + "\n"
    (Path(__file__).parent / "parts.json").write_text(text)


if __name__ == "__main__":
    main()
