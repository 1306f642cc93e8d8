"""Coverage of forecast intervals on short logs, where few segments constrain size and time scale of slow errors."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.extend([str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / "real_logs")])
from common import SETUP, keep, rounded
from predict import inside

import ftbias_jax as ft

RATE, AHEAD = 50.0, (1.0, 10.0)
SIZE = 2.0
"""Standard deviation of the slow errors, in units of the noise of a sample."""
CASES = ((17.0, 2.0, 30), (17.0, 5.0, 30), (17.0, 15.0, 30), (60.0, 5.0, 20), (60.0, 20.0, 20), (300.0, 5.0, 6))
"""Length of a log in s, correlation time in s, and number of logs."""
LOW, HIGH = 0.90, 0.98


def slow_errors(rng, t, time):
    """Sample a first-order Gauss-Markov process on each axis, (T, 6) N, Nm."""
    std, kept = SIZE * SETUP.sensor.noise_std, np.exp(-np.diff(t) / time)
    shocks = rng.normal(size=(len(t), 6))
    error = np.zeros_like(shocks)
    error[0] = shocks[0]
    for k, f in enumerate(kept):
        error[k + 1] = f * error[k] + np.sqrt(1 - f**2) * shocks[k + 1]
    return std * error


def setup_with_slow_errors(time):
    """Setup that states size and correlation time of the slow errors exactly."""
    stated = {"correlated_std": SIZE * SETUP.sensor.noise_std, "correlated_time": np.full(6, time)}
    return replace(SETUP, sensor=replace(SETUP.sensor, **stated))


def study(seconds, time, count):
    """Share of the readings within their 95 % intervals by log and axis, summarised."""
    shares = {name: {ahead: [] for ahead in AHEAD} for name in ("found in the log", "known exactly")}
    for seed in range(count):
        log = ft.simulate(SETUP, duration=seconds, rate=RATE, motion="moves", seed=seed).log
        log = log._replace(wrench=log.wrench + slow_errors(np.random.default_rng(seed), log.t, time))
        for name, setup in (("found in the log", SETUP), ("known exactly", setup_with_slow_errors(time))):
            result = ft.filter_log(setup, log, unchecked=True)
            for ahead in AHEAD:
                shares[name][ahead].append(np.nanmean(inside(result, ahead), axis=0))
    scored = {"seconds": seconds, "correlation time [s]": time, "logs": count}
    for name, of_ahead in shares.items():
        scored[name] = {}
        for ahead, rows in of_ahead.items():
            rows = np.array(rows)
            scored[name][f"{ahead:g} s"] = {
                "mean": rounded(rows.mean()),
                "standard error of the mean": rounded(rows.mean(1).std() / np.sqrt(count)),
                "single axes of logs from 0.90 to 0.98": rounded(((rows >= LOW) & (rows <= HIGH)).mean()),
                "single axes of logs below 0.80": rounded((rows < 0.8).mean()),
            }
    return scored


def main():
    results = []
    for case in CASES:
        results.append(study(*case))
        print(results[-1], flush=True)
    keep(__file__, {"rate_Hz": RATE, "size": SIZE, "cases": results})


if __name__ == "__main__":
    main()
