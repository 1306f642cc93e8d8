"""A thousand logs simulated, then filtered and tuned in one call each: time, samples per second, padding, memory.

``python run.py 100`` takes 100 logs.
"""

import json
import os
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import common
import jax
import numpy as np

import ftbias_jax as ft
from ftbias_jax.calibration.tune import PIECES_AT_ONCE, equal_parts
from ftbias_jax.filtering.samples import arrays_from_log
from ftbias_jax.runtime.compiled_loops import PIECE

LOGS, SECONDS, RATE = 1000, 10.0, 500.0
RAGGED = 10  # there is one log of unequal length for this many logs
LENGTHS = (2.0, 20.0)  # s, uniformly drawn
FIELDS = ("bias", "bias_std", "drift")
ALONE = 8  # number of logs that are also filtered one by one
SERIES = ("t", "q", "dq", "wrench", "temperature")
compiled = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, seconds, **_: compiled.append(seconds) if "backend_compile" in event else None
)


def timed(function, samples=None):
    """Call a function; return its result, and its processor time, wall time and number of compiled programs."""
    cpu, clock, before = time.process_time(), time.perf_counter(), len(compiled)
    result = function()
    cpu, clock = time.process_time() - cpu, time.perf_counter() - clock
    told = {"cpu_seconds": cpu, "seconds": clock, "programs_compiled": len(compiled) - before}
    if samples is not None:
        told |= {"samples_per_cpu_second": samples / cpu, "cpu_us_per_sample": 1e6 * cpu / samples}
    print(told, f"peak {peak():.2f} GiB", flush=True)
    return result, told | {"peak_GiB": peak()}


def peak():
    return int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]) / 2**20


def simulate(seed, seconds=SECONDS):
    return ft.simulate(common.SETUP, duration=seconds, rate=RATE, seed=seed).log


def ragged(count):
    """Simulate logs of 2 to 20 s, as beginnings of logs of 20 s, so that the simulation is compiled only once."""
    rng = np.random.default_rng(0)
    logs = []
    for seed in range(count):
        log, length = simulate(seed, LENGTHS[1]), int(rng.uniform(*LENGTHS) * RATE)
        logs.append(log._replace(**{name: getattr(log, name)[:length] for name in SERIES}))
    return logs


def shares_of_padding(logs):
    """Share of padding among the processed samples, in filtering and in the wrench likelihood that tune maximises."""
    lengths = np.array([len(log.t) for log in logs])
    filtered = PIECE * -(-lengths // PIECE)
    samples = [arrays_from_log(log) for log in logs]
    parts = equal_parts(samples, PIECES_AT_ONCE)
    tuned = sum(len(part) * PIECE * -(-max(len(log.dt) for log in part) // PIECE) for part in parts)
    powers = 2 ** np.ceil(np.log2(lengths))
    return {
        "filter": 1 - lengths.sum() / filtered.sum(),
        "tune": 1 - lengths.sum() / tuned,
        "if all of the programs' length were worked on": 1 - lengths.sum() / powers.sum(),
    }


def difference(found, alone):
    pairs = ((getattr(a, name), getattr(b, name)) for a, b in zip(found, alone, strict=True) for name in FIELDS)
    return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in pairs)


def main(count):
    load, setup = [os.getloadavg()[0]], common.SETUP
    logs, simulating = timed(lambda: [simulate(seed) for seed in range(count)])
    size = sum(len(log.t) for log in logs)
    _, first = timed(lambda: ft.filter_log(setup, logs[0]))
    alone, single = timed(lambda: [ft.filter_log(setup, log) for log in logs[:ALONE]], ALONE * len(logs[0].t))
    results, filtering = timed(lambda: ft.filter_log(setup, logs, fields=FIELDS), size)
    assert not results.errors
    unequal = ragged(max(2, count // RAGGED))
    lengths = sum(len(log.t) for log in unequal)
    _, first_ragged = timed(lambda: ft.filter_log(setup, unequal, fields=FIELDS), lengths)
    _, of_ragged = timed(lambda: ft.filter_log(setup, unequal, fields=FIELDS), lengths)
    tuned, tuning = timed(lambda: ft.tune(setup, logs), size)
    load.append(os.getloadavg()[0])
    result = {
        "logs": count,
        "samples": size,
        "simulate": simulating,
        "first log filtered": first,
        "filter, logs one by one": single,
        "filter, all in one call": filtering,
        "one call / one by one": filtering["cpu_us_per_sample"] / single["cpu_us_per_sample"],
        "largest relative difference": difference(results[:ALONE], alone),
        "2 to 20 s": {
            "logs": len(unequal),
            "first call": first_ragged,
            "second call": of_ragged,
            "padding": shares_of_padding(unequal),
        },
        "tune": tuning,
        "tuned / true": {
            "noise_std": (tuned.setup.sensor.noise_std / setup.sensor.noise_std).tolist(),
            "noise_density": (tuned.setup.bias.noise_density / setup.bias.noise_density).tolist(),
        },
        "load of the machine": load,
        "cores": len(os.sched_getaffinity(0)),
    }
    result = jax.tree.map(lambda x: float(f"{x:.3g}") if isinstance(x, float) else x, result)
    print(json.dumps(result, indent=1))
    common.keep(__file__, result)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else LOGS)
