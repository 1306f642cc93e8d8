"""The pipeline on a graphics card, per one core: 64, 1,000 and 4,000 logs of 4,096 samples, in both precisions.

Each device is a process of its own, both at once; what the card finds is compared with what the core finds. Wall time of
compiled programs whose arguments are on the device.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PLATFORM = sys.argv[1] if len(sys.argv) > 2 else None
if PLATFORM == "cpu":
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
sys.path.insert(0, str(Path(__file__).parents[1]))

import common
import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.filtering import likelihood, pipeline
from ftbias_jax.filtering.method.filter_samples import filter_samples
from ftbias_jax.filtering.noise.blocks import layout_of

RATE, LENGTH, MADE = 1e-3, 4096, 64
COUNTS = (64, 1000, 4000)
OPTIONS = pipeline.DEFAULT_OPTIONS
PARAMS = common.PARAMS._replace(joint=common.PARAMS.joint._replace(process_density=jnp.full(7, 30.0)))


def make_logs():
    t = RATE * jnp.arange(LENGTH)
    motions = jax.tree.map(lambda *x: jnp.stack(x), *(common.sines(seed, t) for seed in range(MADE)))
    samples = common.simulate_logs(0, MADE, PARAMS, motions)[1]
    return samples._replace(dt=jnp.full((MADE, LENGTH), RATE).at[:, 0].set(0.0))


def bias_of(params, samples):
    """Mean and variance of bias and drift at every sample."""

    def keep(state, info):
        return state.bias.mean, jnp.diagonal(state.bias.covariance)

    return pipeline.run(params, pipeline.init(params, samples), samples, OPTIONS, keep)[1]


def score(params, samples):
    return likelihood.log_likelihood(params, samples, OPTIONS)


def each(function):
    return lambda params, logs: jax.vmap(function, (None, 0))(params, logs)


def gradient(params, logs):
    """Value of all logs and slopes in the noise of joints and bias."""

    def nats(joint, bias):
        return each(score)(params._replace(joint=joint, bias=bias), logs).sum()

    return jax.value_and_grad(nats, argnums=(0, 1))(params.joint, params.bias)


def method(params, logs):
    """Bias and its standard deviation by all passes of ``filter_log``."""
    layout = layout_of(np.r_[0.0, np.full(LENGTH - 1, RATE)])

    def one(params, samples):
        states = filter_samples(params, samples, layout=layout)[1]
        return states.bias, states.bias_std

    return each(one)(params, logs)


CONTESTANTS = {"pipeline": each(bias_of), "likelihood": each(score), "gradient": gradient, "method": method}


def timed(function, *arguments):
    start = time.perf_counter()
    found = jax.block_until_ready(function(*arguments))
    return time.perf_counter() - start, found


def of_device(folder):
    made, found = make_logs(), {}
    only = set(sys.argv[3].split(",")) if len(sys.argv) > 3 else set(CONTESTANTS)
    for dtype in ("float64", "float32"):
        params, few = jax.tree.map(lambda x: x.astype(dtype), (PARAMS, made))
        for name in [x for x in CONTESTANTS if x in only]:
            function = CONTESTANTS[name]
            for count in COUNTS:
                if name == "method" and count > 1000:
                    continue
                logs = jax.tree.map(lambda x: jnp.tile(x, (-(-count // MADE), *[1] * (x.ndim - 1)))[:count], few)
                key = f"{name}, {dtype}, {count}"
                try:
                    start = time.perf_counter()
                    program = jax.jit(function).lower(params, logs).compile()
                    compiled = time.perf_counter() - start
                    if count == MADE:
                        (Path(folder) / f"{PLATFORM}_{name}_{dtype}.hlo").write_text(program.as_text())
                    first, values = timed(program, params, logs)
                    if count == MADE:
                        np.savez(Path(folder) / f"{PLATFORM}_{name}_{dtype}.npz", *jax.tree.leaves(values))
                    del values
                    rounds = [timed(program, params, logs)[0] for _ in range(2 if first < 3 else 1)]
                    found[key] = {"us_per_sample": 1e6 * min(rounds) / (count * LENGTH), "compile_s": compiled}
                except Exception as error:
                    found[key] = {"error": f"{type(error).__name__}: {error}"[:1500]}
                print(PLATFORM, key, found[key], flush=True)
    stats = jax.devices()[0].memory_stats() or {}
    return {"device": jax.devices()[0].device_kind, "peak_GB": stats.get("peak_bytes_in_use", 0) / 1e9, "found": found}


def main():
    with tempfile.TemporaryDirectory() as folder:
        devices = [subprocess.Popen([sys.executable, __file__, x, folder]) for x in ("cpu", "cuda")]
        [x.wait() for x in devices]


if __name__ == "__main__":
    if PLATFORM:
        result = of_device(sys.argv[2])
        (Path(sys.argv[2]) / f"{PLATFORM}.json").write_text(json.dumps(result, indent=1))
    else:
        main()
