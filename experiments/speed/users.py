"""Processor time on one core of what users call, relative to the bare pipeline with mean and variance of the bias.

User calls include the checks and all fields of a result. Cold and cached commands run as separate processes.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
sys.path.insert(0, str(Path(__file__).parents[1]))

import common
import jax
import jax.numpy as jnp
import numpy as np

import ftbias_jax as ft
from ftbias_jax.filtering import pipeline
from ftbias_jax.filtering.params_for_log import params_for_log

RATE, ROUNDS = 500.0, 5
SHORT, LONG, MANY, EACH = 45.0, 450.0, 1000, 10.0


def made(seconds, seed=0):
    return ft.simulate(common.SETUP, duration=seconds, rate=RATE, seed=seed).log


def best(function, rounds=ROUNDS):
    """Least processor time of some rounds, s, after a warm-up round."""
    function()
    times = []
    for _ in range(rounds):
        start = time.process_time()
        function()
        times.append(time.process_time() - start)
    return min(times)


def of_log(*logs, rounds=ROUNDS, **options):
    """Processor time of ``ft.filter_log`` in microseconds per sample."""
    given = logs[0] if len(logs) == 1 else list(logs)
    seconds = best(lambda: ft.filter_log(common.SETUP, given, **options), rounds)
    return 1e6 * seconds / sum(len(log.t) for log in logs)


def pipeline_alone(log):
    """Processor time, s, of ``pipeline.run`` that returns mean and variance of bias and drift."""
    samples = ft.samples_from_log(log)._replace(temperature=None)
    params = params_for_log(common.SETUP, samples)
    state = pipeline.init(params, samples)

    def keep(state, info):
        return state.bias.mean, jnp.diagonal(state.bias.covariance)

    run = jax.jit(lambda samples: pipeline.run(params, state, samples, pipeline.DEFAULT_OPTIONS, keep)[1])
    return best(lambda: jax.block_until_ready(run(samples)))


def command(folder, cache):
    """Processor seconds and peak MB of ``ftbias filter`` as a process of its own."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    code = (
        "import sys; from ftbias_jax.cli.main import main; code = main(sys.argv[1:]);"
        "peak = open('/proc/self/status').read().split('VmHWM:')[1].split()[0];"  # getrusage includes the parent
        "print('peak', int(peak) / 1024); sys.exit(code)"
    )
    files = [str(folder / name) for name in ("log.npz", "setup.toml", "out.npz")]
    arguments = ["filter", files[0], "--setup", files[1], "-o", files[2]]
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], env=environment, capture_output=True, text=True, check=True
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = sum(getattr(after, x) - getattr(before, x) for x in ("ru_utime", "ru_stime"))
    return {"s": seconds, "peak MB": float(done.stdout.split("peak")[1])}


def main():
    short, long = made(SHORT), made(LONG)
    alone = 1e6 * pipeline_alone(long) / len(long.t)
    many = [made(EACH, seed) for seed in range(20)] * (MANY // 20)
    with jax.enable_x64(True):
        us = {
            "filter_log, 45 s": of_log(short),
            "filter_log, 450 s": of_log(long),
            "filter_log, 450 s, unchecked": of_log(long, unchecked=True),
            "filter_log, 450 s, as stated": of_log(long, as_stated=True),
            "filter_log, 1,000 logs of 10 s": of_log(*many, rounds=1, fields=("bias",)),
        }
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "setup.toml").write_text(ft.dump_setup(common.SETUP))
        np.savez(folder / "log.npz", t=short.t, q=short.q, dq=short.dq, wrench=short.wrench)
        runs = [command(folder, folder / "cache") for _ in range(3)]
    result = {
        "pipeline.run, mean and variance of the bias, us a sample": alone,
        "us a sample": us,
        "per pipeline.run": {name: x / alone for name, x in us.items()},
        "ftbias filter of 45 s": dict(zip(("cold", "second", "third"), runs, strict=True)),
    }
    result = jax.tree.map(lambda x: float(f"{x:.3g}") if isinstance(x, float) else x, result)
    print(json.dumps(result, indent=1))
    (Path(__file__).parent / "users.json").write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
