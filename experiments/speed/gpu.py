"""Speed of many logs on a GPU relative to one CPU core: wall time of compiled programs, arguments on the device.

64, 1,000 and 4,000 logs of 4,096 samples in both precisions, and ``ft.filter_log`` of 300 logs of 10 s at 500 Hz. Each
device has a process of its own, and both run together; the results of the GPU are compared with those of the CPU.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PLATFORM, FOLDER = sys.argv[1:] if len(sys.argv) > 1 else ("", "")
if PLATFORM == "cpu":
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
if not PLATFORM:  # the parent process must not allocate GPU memory
    os.environ["JAX_PLATFORMS"] = "cpu"
sys.path.insert(0, str(Path(__file__).parents[1]))

import common
import jax
import jax.numpy as jnp
import numpy as np
from made_logs import PARAMS, RATE, cast, make_logs

import ftbias_jax as ft
from ftbias_jax.filtering import likelihood, pipeline

LENGTH, FEW, ROUNDS = 4096, 64, 3
COUNTS = {"cpu": (FEW,), "cuda": (FEW, 1000, 4000)}
"""Device -> numbers of logs; a CPU core processes them one after the other."""
MOST = {"method": 1000}
"""Contestant -> largest number of logs that it is tried with."""
LOGS, SECONDS, DIFFERENT = 300, 10.0, 20
OPTIONS = pipeline.DEFAULT_OPTIONS
LAYOUT = ft.layout_of(np.r_[0.0, np.full(LENGTH - 1, RATE)])
TIME_LIMIT = 330
"""s after which a device is stopped; unfinished work is left out."""


def bias_of(params, samples):
    """Return mean and variance of bias and drift at every sample."""

    def keep(state, info):
        return state.bias.mean, jnp.diagonal(state.bias.covariance)

    return pipeline.run(params, pipeline.init(params, samples), samples, OPTIONS, keep)[1]


def score(params, samples):
    return likelihood.log_likelihood(params, samples, OPTIONS)


def by_method(params, samples):
    """Bias and its standard deviation by all passes of ``filter_log`` except the fit of the joints' noise."""
    states = ft.filter_samples(params, samples, layout=LAYOUT)[1]
    return states.bias, states.bias_std


def each(function):
    return lambda params, logs: jax.vmap(function, (None, 0))(params, logs)


def gradient(params, logs):
    """Log-likelihood of all logs and its gradient with respect to the noise of joints and bias."""

    def nats(joint, bias):
        return each(score)(params._replace(joint=joint, bias=bias), logs).sum()

    return jax.value_and_grad(nats, argnums=(0, 1))(params.joint, params.bias)


CONTESTANTS = {"pipeline": each(bias_of), "likelihood": each(score), "gradient": gradient, "method": each(by_method)}


def timed(function, *arguments):
    start = time.perf_counter()
    found = jax.block_until_ready(function(*arguments))
    return time.perf_counter() - start, found


def measured(name, dtype, count, params, few):
    logs = jax.tree.map(lambda x: jnp.tile(x, (-(-count // FEW), *[1] * (x.ndim - 1)))[:count], few)
    start = time.perf_counter()
    program = jax.jit(CONTESTANTS[name]).lower(params, logs).compile()
    seconds = time.perf_counter() - start
    values = timed(program, params, logs)[1]
    if count == FEW:
        np.savez(Path(FOLDER) / f"{PLATFORM}, {name}, {dtype}.npz", *jax.tree.leaves(values))
    del values
    best = min(timed(program, params, logs)[0] for _ in range(ROUNDS if count < 4000 else 1))
    memory = program.memory_analysis()
    return {
        "us_per_sample": 1e6 * best / (count * LENGTH),
        "compile_s": seconds,
        "memory_GB": (memory.temp_size_in_bytes + memory.output_size_in_bytes) / 1e9,
    }


def of_verb(logs):
    """Time ``ft.filter_log`` of logs in memory, ms per log, in the first and in a second call."""
    first, _ = timed(lambda: ft.filter_log(common.SETUP, logs, fields=["bias"]))
    again, results = timed(lambda: ft.filter_log(common.SETUP, logs, fields=["bias"]))
    np.savez(Path(FOLDER) / f"{PLATFORM}, filter_log, float64.npz", *(x.bias for x in results[:DIFFERENT]))
    return {"first_ms_a_log": 1e3 * first / len(logs), "ms_a_log": 1e3 * again / len(logs)}


def of_device():
    """Run all work of one device; each finished part is written to a file, so that a later failure loses nothing."""
    found, made = {"device": jax.devices()[0].device_kind}, make_logs(FEW, LENGTH)

    def note(key, function, *arguments):
        try:
            found[key] = function(*arguments)
        except Exception as error:  # for example too little memory on a smaller GPU
            found[key] = {"error": f"{type(error).__name__}: {error}"[:300]}
        print(PLATFORM, key, found[key], flush=True)
        (Path(FOLDER) / f"{PLATFORM}.json").write_text(json.dumps(found))

    files = np.load(Path(FOLDER) / "logs.npz")
    logs = [ft.Log.from_arrays(common.SETUP, *(files[f"{x}{i}"] for x in ("t", "q", "w"))) for i in range(DIFFERENT)]
    note(f"filter_log, {LOGS} logs", of_verb, (logs * (LOGS // DIFFERENT)))
    for dtype in (jnp.float64, jnp.float32):
        params, few = cast((PARAMS, made), dtype)
        for name in CONTESTANTS:
            for count in COUNTS[PLATFORM]:
                if count <= MOST.get(name, count):
                    bits = jnp.dtype(dtype).name
                    note(f"{name}, {bits}, {count} logs", measured, name, bits, count, params, few)


def difference(name, dtype, folder):
    """Largest difference between the devices' results, relative to the largest value; None = one has no result."""
    try:
        files = [np.load(folder / f"{x}, {name}, {dtype}.npz") for x in COUNTS]
    except FileNotFoundError:
        return None
    pairs = [[x[key] for x in files] for key in files[0]]
    return float(max(np.abs(a - b).max() / max(np.abs(a).max(), 1e-300) for a, b in pairs))


def main():
    with tempfile.TemporaryDirectory() as place:
        folder, arrays = Path(place), {}
        for i in range(DIFFERENT):
            log = ft.simulate(common.SETUP, duration=SECONDS, rate=500.0, seed=i).log
            arrays |= {f"t{i}": log.t, f"q{i}": log.q, f"w{i}": log.wrench}
        np.savez(folder / "logs.npz", **arrays)
        environment = {x: {**os.environ, "JAX_PLATFORMS": "cpu" if x == "cpu" else f"{x},cpu"} for x in COUNTS}
        running = [subprocess.Popen([sys.executable, __file__, x, place], env=environment[x]) for x in COUNTS]
        limit = time.monotonic() + TIME_LIMIT
        for process in running:
            try:
                process.wait(max(limit - time.monotonic(), 0))
            except subprocess.TimeoutExpired:
                process.kill()
        result = {x: json.loads((folder / f"{x}.json").read_text()) for x in COUNTS}
        names = [
            *((name, dtype) for dtype in ("float64", "float32") for name in CONTESTANTS),
            ("filter_log", "float64"),
        ]
        result["difference"] = {f"{name}, {dtype}": difference(name, dtype, folder) for name, dtype in names}
    one = {key: x["us_per_sample"] for key, x in result["cpu"].items() if key.endswith(f" {FEW} logs")}
    result["core_per_card"] = {
        key: one[f"{key.rsplit(',', 1)[0]}, {FEW} logs"] / x["us_per_sample"]
        for key, x in result["cuda"].items()
        if "us_per_sample" in x
    }
    result = jax.tree.map(lambda x: float(f"{x:.3g}") if isinstance(x, float) else x, result)
    print(json.dumps(result, indent=1))
    common.keep(__file__, result, name="gpu")


if __name__ == "__main__":
    of_device() if FOLDER else main()
