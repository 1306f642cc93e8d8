#!/usr/bin/env python3
"""Wrenches stamped by a clock that runs fast or slow: is its rate found, without false alarms? python run.py.

The wrench is sampled at true times, but stamped by a clock with a rate and an offset of its own. The diagnosed values
are then stated in [log.clocks] and [log.time_offsets], and the stamps that the reader corrects with them are compared
with the true times. Half of the logs without a clock rate have a constant delay.
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import ftbias_jax as ft

sys.path.insert(0, str(Path(__file__).parent.parent))
from random_setup import random_setup

ROBOTS, MOTIONS = ("panda", "ur10e", "iiwa14"), ("sines", "moves")
RATE, DURATION = 250.0, 60.0
"""Hz of the joints, twice the rate of the wrench; s."""


def recorded(setup, made, rate, offset):
    """The log with every other wrench, stamped by a clock that is ``offset`` s late and runs ``rate`` ppm fast."""
    log = made.log
    taken = log.t[::2]
    stamps = taken + offset + 1e-6 * rate * taken
    return ft.Log.from_arrays(setup, (log.t, stamps), log.q, log.wrench[::2], log.dq, raw=True), (taken, stamps)


def one(seed, drifts, delayed):
    """Simulate a log with or without a clock rate, and return its diagnosis as a row."""
    rng = np.random.default_rng(seed)
    robot, motion = ROBOTS[seed % 3], MOTIONS[seed % 2]
    setup = random_setup(rng, robot)
    made = ft.simulate(setup, duration=DURATION, rate=RATE, motion=motion, seed=seed)
    rate = float(rng.choice([-1, 1]) * np.exp(rng.uniform(np.log(50), np.log(5000)))) if drifts else 0.0
    offset = float(rng.uniform(-0.02, 0.1)) if drifts or delayed else 0.0
    log, (taken, stamps) = recorded(setup, made, rate, offset)
    start = time.process_time()
    found = ft.diagnose(setup, [log])
    row = {
        "seed": seed,
        "robot": robot,
        "motion": motion,
        "rate": round(rate, 2),
        "offset": round(offset, 5),
        "verdict": found.verdict,
        "causes": [cause.effect for cause in found.causes],
        "cpu_seconds": round(time.process_time() - start, 1),
    }
    cause = next((cause for cause in found.causes if cause.effect == "clock_drift"), None)
    if cause is None:
        return row
    told = {name: float(np.asarray(cause.parameters[name])) for name in ("rate", "offset")}
    stderr = {name: float(np.asarray(cause.stderr[name])) for name in told}
    stated = {"clocks": {"wrench_rate": told["rate"]}, "time_offsets": {"wrench": -told["offset"]}}
    mended = replace(setup, log=replace(setup.log, **stated))
    right = ft.Log.from_arrays(mended, (made.log.t, stamps), made.log.q, made.log.wrench[::2], made.log.dq, raw=True)
    read = right.t[np.isfinite(right.wrench[:, 2])] + right.start
    row |= {
        "told": {name: round(value, 5) for name, value in told.items()},
        "stderr": {name: round(value, 5) for name, value in stderr.items()},
        "sigmas": round((told["rate"] - rate) / stderr["rate"], 2),
        "stamps_ms": round(1e3 * float(np.abs(read - taken).max()), 3),
    }
    return row


def table(rows):
    """Summary of the logs with and without a clock rate."""
    with_rate = [row for row in rows if row["rate"]]
    named = [row for row in with_rate if row["causes"][:1] == ["clock_drift"]]
    without = [row for row in rows if not row["rate"]]
    return {
        "logs with a rate": len(with_rate),
        "named first": len(named),
        "explained": sum(row["verdict"] == "explained" for row in named),
        "within three standard errors": sum(abs(row["sigmas"]) < 3 for row in named),
        "largest error of the mended stamps, ms": max((row["stamps_ms"] for row in named), default=None),
        "not named first, ppm": [row["rate"] for row in with_rate if row not in named],
        "logs without": len(without),
        "named there": sum("clock_drift" in row["causes"] for row in without),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=30, help="logs with a rate (%(default)s)")
    parser.add_argument("--none", type=int, default=50, help="logs without one (%(default)s)")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    rows = []
    for number in range(asked.count + asked.none):
        rows.append(one(1000 * asked.seed + number, number < asked.count, number % 2))
        print(rows[-1], flush=True)
    from common import keep

    keep(__file__, {"table": table(rows), "logs": rows})
