"""Typical logger artefacts in joints, stamps and tables of logs whose setup is right: no cause may be diagnosed.

python experiments/loggers/run.py [--count 12] [--seed 1127] writes result.json beside this script.
"""

import argparse
import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

import ftbias_jax as ft
from ftbias_jax.io.cleaning import clean

sys.path[:0] = [str(Path(__file__).parents[1])]
from common import keep  # noqa: E402

from validation.generator.make import Limits, make_set  # noqa: E402

BEGIN = 0.2
"""Share of a log that is cut off at its start, so that it begins in motion."""
LAG = {"low_pass": {"cutoff": 0.4}}
"""Lag of the sensor in logs that begin in motion."""
WARM_UP = 5.0
"""s at the start of a log that are excluded from the error of the bias."""


def rounded(log, degrees):
    step = np.radians(degrees)
    return log._replace(q=step * np.round(log.q / step))


def lagging(values, t, seconds):
    """Filter values (T, n) by a first-order low-pass with a time constant in seconds."""
    late = values.copy()
    for i, share in enumerate(-np.expm1(-np.diff(t) / seconds), 1):
        late[i] = late[i - 1] + share * (values[i] - late[i - 1])
    return late


def held(values, samples):
    return values[np.arange(len(values)) // samples * samples]


def velocities(log):
    return np.gradient(log.q, log.t, axis=0)


def somewhere(log):
    """Indices of three rows of a log that are far apart."""
    return np.array([3, 5, 8]) * len(log.t) // 10


def with_rows(values, rows, others):
    changed = values.copy()
    changed[rows] = others[rows]
    return changed


def zeros(log, rows):
    """Set joints, velocities and wrench of some rows to zero, as in messages without content."""
    changed = {name: with_rows(getattr(log, name), rows, 0 * getattr(log, name)) for name in ("q", "dq", "wrench")}
    return log._replace(**changed)


def frozen(log, last, repeats):
    """Repeat the joints of each row in ``last`` over the following ``repeats`` rows, as if those were missing."""
    rows = np.add.outer(last, np.arange(1, repeats + 1)).ravel()
    q, dq = log.q.copy(), log.dq.copy()
    q[rows], dq[rows] = (values[np.repeat(last, repeats)] for values in (q, dq))
    return log._replace(q=q, dq=dq)


def lost(log, samples=20):
    """Remove rows in the middle and close the gap in the stamps, so that all later stamps are too early."""
    middle = len(log.t) // 2
    rows = np.r_[:middle, middle + samples : len(log.t)]
    t = log.t - np.where(log.t > log.t[middle], log.t[middle + samples] - log.t[middle], 0)
    return log._replace(**{name: getattr(log, name)[rows] for name in ("q", "dq", "wrench", "temperature")}, t=t[rows])


CHANGES = {
    "as recorded": lambda log: log,
    "no velocities": lambda log: log._replace(dq=np.full_like(log.q, np.nan)),
    "positions rounded to 0.01 degrees": lambda log: rounded(log, 0.01),
    "positions rounded to 0.05 degrees, no velocities": lambda log: rounded(
        log._replace(dq=np.full_like(log.q, np.nan)), 0.05
    ),
    "velocities late by 5 ms": lambda log: log._replace(dq=lagging(log.dq, log.t, 0.005)),
    "velocities late by 20 ms": lambda log: log._replace(dq=lagging(log.dq, log.t, 0.02)),
    "velocities 2 % too large": lambda log: log._replace(dq=1.02 * log.dq),
    "velocities are differences of positions": lambda log: log._replace(dq=velocities(log)),
    "the same, smoothed": lambda log: log._replace(dq=lagging(velocities(log), log.t, 0.02)),
    "joints held for four samples": lambda log: log._replace(q=held(log.q, 4), dq=held(log.dq, 4)),
    "three joint readings off by 0.1 rad": lambda log: log._replace(q=with_rows(log.q, somewhere(log), log.q + 0.1)),
    "three messages of zeros": lambda log: zeros(log, somewhere(log)),
    "the first message is zeros": lambda log: zeros(log, [0]),
    "the joints stand still for 20 samples, three times": lambda log: frozen(log, somewhere(log), 19),
    "samples are lost, and the others counted": lost,
    "the last 20 samples repeat the joints": lambda log: frozen(log, [len(log.t) - 21], 20),
}
"""Name -> function that changes a log into what some loggers or controllers write."""
WAIT = 0.3
"""Mean wait of messages before they are logged, in sample intervals; some wait ten times as long."""


def queued(arrivals):
    """Delay arrivals so that no message overtakes another."""
    return np.maximum.accumulate(arrivals) + 1e-7 * np.arange(len(arrivals))


def arrival(t, rng):
    """Stamp messages at their arrival, in order."""
    wait = np.median(np.diff(t)) * rng.exponential(WAIT * np.where(rng.random(len(t)) < 0.01, 10, 1))
    return queued(t + wait)


def packets(t, rng, count=8):
    """Stamp readings that are sent together in packets of ``count``."""
    number = np.arange(len(t))
    return t[np.minimum(number // count * count + count - 1, len(t) - 1)] + 1e-5 * (number % count)


def hiccups(t, rng):
    """Delay the stamps by a recorder that is busy five times, for up to 30 ms."""
    wait = np.zeros(len(t))
    wait[rng.integers(0, len(t), 5)] = rng.uniform(0, 0.03, 5)
    return queued(t + wait)


STAMPS = {
    "stamps of arrival": arrival,
    "stamps of packets of eight": packets,
    "stamps of a recorder that is busy five times": hiccups,
    "stamps with an error of 20 % of the interval": lambda t, rng: (
        t + np.median(np.diff(t)) * rng.uniform(-0.2, 0.2, len(t))
    ),
    "stamps rounded to milliseconds": lambda t, rng: np.round(t, 3),
}
"""Name -> function that returns the stamps (T,) s in the file of readings that were taken at t (T,) s."""
SLOWER = 40.0
"""Rate in Hz of readings that were interpolated linearly onto the rows."""


def interpolated(names):
    """Return a change that samples some arrays more slowly and interpolates them onto the rows, as most programs do."""

    def change(arrays, rng):
        t = arrays["t"]
        taken = t[:: round((len(t) - 1) / (t[-1] - t[0]) / SLOWER)]
        slow = {name: arrays[name][np.searchsorted(t, taken)] for name in names if name in arrays}
        return {**arrays, **{n: np.stack([np.interp(t, taken, x) for x in v.T], 1) for n, v in slow.items()}}

    return change


TABLES = {
    "joints interpolated from 40 Hz": interpolated(("q", "dq")),
    "joints and wrench interpolated from 40 Hz": interpolated(("q", "dq", "wrench")),
}
"""Name -> function that changes the arrays of a log into those that some programs write."""
STATED = {
    "noise of positions stated 5 times too small": "position_noise_std",
    "noise of velocities stated 5 times too small": "velocity_noise_std",
}
"""Name -> key of [joints] whose value in the setup is wrong."""


def bias_error(setup, log, truth):
    """Rms error of the bias over all seconds and axes, in standard deviations of the noise."""
    result = ft.filter_log(setup, clean(log))
    seconds = np.arange(WARM_UP, len(truth) - 1)
    rows = np.searchsorted(result.t - log.start, seconds)
    off = (result.bias[rows] - truth[seconds.astype(int)]) / setup.sensor.noise_std
    return float(np.sqrt((off**2).mean()))


def named(setup, log):
    """Names of the diagnosed causes and terms in one string; "none" if there are none."""
    found = ft.diagnose(setup, [log])
    return " ".join([cause.effect for cause in found.causes] + ["term" for _ in found.terms]) or "none"


def stamped(change):
    return lambda arrays, rng: {**arrays, "t": change(arrays["t"], rng)}


def read_again(path, setup, change, seed):
    """Read the log of a file again, with changed stamps or readings."""
    return ft.Log.from_arrays(setup, **change(dict(np.load(path)), np.random.default_rng(seed)), raw=True)


def study(path, setup, log, truth, seed):
    """Yield name, diagnosed causes and bias error relative to the log as recorded (or None) of each change."""
    best = bias_error(setup, log, truth)
    for name, change in {**{name: stamped(stamps) for name, stamps in STAMPS.items()}, **TABLES}.items():
        changed = read_again(path, setup, change, seed)
        yield name, named(setup, changed), bias_error(setup, changed, truth) / best
    for name, change in CHANGES.items():
        changed = change(log)
        yield name, named(setup, changed), bias_error(setup, changed, truth) / best
    for name, key in STATED.items():
        sure = replace(setup, joints=replace(setup.joints, **{key: getattr(setup.joints, key) / 5}))
        yield name, named(sure, log), bias_error(sure, log, truth) / best
    lagged = replace(setup, effects=LAG)
    cut = begun(ft.simulate(lagged, duration=40.0, rate=250.0, seed=seed).log)
    yield "begins in motion, the sensor lags", named(setup, cut), None
    yield "the same, with a setup that states the lag", named(lagged, cut), None


def begun(log):
    """Cut off the first ``BEGIN`` share of a log."""
    first = int(BEGIN * len(log.t))
    rows = {name: getattr(log, name)[first:] for name in ("q", "dq", "wrench", "temperature")}
    return log._replace(t=log.t[first:] - log.t[first], **rows)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=12)
    parser.add_argument("--seed", type=int, default=1127)
    count, seed = vars(parser.parse_args()).values()
    table = {}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        make_set(folder, "none", count, seed, Limits((20.0, 50.0), (125.0, 200.0, 250.0, 400.0), True))
        truth = json.loads((folder / "truth.json").read_text())
        for number, path in enumerate(sorted(folder.glob("log_*.npz"))):
            setup = ft.load_setup(path.with_suffix(".toml"))
            log = ft.read_log(path, setup, raw=True)
            for name, found, error in study(path, setup, log, np.array(truth[path.stem]["bias_1hz"]), seed + number):
                row = table.setdefault(name, {"named": {}, "bias error over that of the log as recorded": []})
                row["named"][found] = row["named"].get(found, 0) + 1
                row["bias error over that of the log as recorded"] += [] if error is None else [round(error, 2)]
            print(path.stem, flush=True)
    keep(__file__, table)


if __name__ == "__main__":
    main()
