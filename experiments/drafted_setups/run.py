#!/usr/bin/env python3
"""From a draft to valid error bars: python run.py [--count 24] [--seed 1] [--jobs 1] [--rows ROWS.jsonl].

A draft contains neither the sensor's noise, nor its position on the flange, nor the tool's inertia, and only rough
values of mass and centre of mass. ``calibrate`` turns it into a setup with one log, which has one cause or none. A
second log is filtered with this setup, and its bias compared with the truth. Logs are made by ``simulate``, because the
steps from a log to error bars are tested, not whether real causes have the catalogue's forms.
"""

import sys
import time
from pathlib import Path

import numpy as np

import ftbias_jax as ft

sys.path.insert(0, str(Path(__file__).parents[1]))
from by_rows import by_rows

ROBOTS = (
    *("panda", "fr3_link8", "iiwa7", "lbr_med7", "xarm7", "gen3", "sawyer"),
    *("ur3e", "ur5e", "ur10e", "gofa", "irb120"),
)
BIAS = {"noise_density": 2e-4}
TORQUE = 0.04
"""Ratio of torque noise to force noise, Nm per N."""
LEFT_OPEN = {"mount_translation", "tool_inertia", "tool_mass", "tool_com", "noise_level"}
"""Effects that a draft leaves open; they do not count as causes found."""


def some_effects(rng, mass):
    """Draw one effect with its parameters, or none."""
    scale = np.r_[1, 1, 1, [TORQUE] * 3]
    leaks = rng.normal(size=(6, 6)) * 0.01 * (1 - np.eye(6)) * scale[:, None] / scale
    effects = {
        "none": None,
        "gain": {"gain": (1 + 0.02 * rng.normal(size=6)).tolist()},
        "time_delay": {"delay": float(rng.uniform(0.004, 0.03))},
        "cable": {"stiffness": float(rng.uniform(2, 15)), "rest_length": 0.1, "anchor": [0.2, 0.2, 0.9]},
        "gravity_tilt": {"gravity": [*(0.2 * rng.normal(size=2)).tolist(), -9.8]},
        "encoder_offset": {"joint": int(rng.integers(2, 6)), "offset": float(rng.choice([-0.02, 0.02]))},
        "crosstalk": {"matrix": (np.eye(6) + leaks).tolist()},
        "hysteresis": {"width": (0.1 * mass * scale).tolist()},
        "low_pass": {"cutoff": float(rng.uniform(3, 15))},
    }
    name = str(rng.choice(list(effects)))
    return {name: effects[name]} if effects[name] else {}


def setups(rng):
    """Draw the true setup, its effects, and the draft."""
    robot, force = {"model": str(rng.choice(ROBOTS))}, float(rng.choice([0.02, 0.1, 0.3]))
    mass, center = float(rng.uniform(0.3, 3)), (rng.normal(size=3) * [0.02, 0.02, 0.03] + [0, 0, 0.06]).tolist()
    inertia = (0.003 * mass * np.array([1, 0, 0, 1, 0, 0.7])).tolist()
    place = [0.0, 0.0, float(rng.choice([0.0, 0.03, 0.05]))]
    true = {
        "robot": robot,
        "sensor": {"noise_std": [force] * 3 + [TORQUE * force] * 3, "translation": place},
        "tool": {"mass": mass, "center_of_mass": center, "inertia": inertia},
        "bias": BIAS,
    }
    guess = round(mass * float(rng.choice([0.85, 1, 1.1])), 2)
    draft = {
        "robot": robot,
        "sensor": {"noise_std": [1.0] * 3 + [0.05] * 3},
        "tool": {"mass": guess, "center_of_mass": [0, 0, round(center[2], 2)]},
        "bias": BIAS,
    }
    return true, some_effects(rng, mass), draft


def one(index, seed):
    """Calibrate the draft of one robot with a log, and score the bias of another log with its error bars."""
    rng = np.random.default_rng([seed, index])
    true, effects, draft = setups(rng)
    setup = ft.parse_setup(true)
    duration, rate = float(rng.choice([40, 60, 90])), float(rng.choice([100, 125, 250, 500]))
    log, other = (ft.simulate(setup, effects, duration=duration, rate=rate, seed=10 * index + k) for k in (0, 1))
    begin = time.monotonic()
    found = ft.calibrate(ft.parse_setup(draft), [log.log])
    seconds = time.monotonic() - begin
    result = ft.filter_log(found.setup, other.log)
    settled = slice(len(result.t) // 4, None)  # earlier, the prior dominates
    miss = (np.abs(result.bias - other.truth.bias[: len(result.bias)]) / result.bias_std)[settled]
    tool = found.setup.tool
    off = (tool.mass - true["tool"]["mass"]) / (tool.mass_std or np.nan)
    return {
        "index": index,
        "robot": true["robot"]["model"],
        "cause": next(iter(effects), "none"),
        "found": sorted({*found.setup.effects} - LEFT_OPEN),
        "noise": true["sensor"]["noise_std"][0],
        "duration": duration,
        "rate": rate,
        "within_two": [round(float(x), 3) for x in (miss < 2).mean(0)],
        "median_miss": round(float(np.median(miss, 0).max()), 2),
        "largest_miss": round(float(miss.max()), 1),
        "mass_stderrs_off": round(float(off), 2),
        "mass_percent_off": round(100 * (tool.mass / true["tool"]["mass"] - 1), 2),
        "seconds": round(seconds),
    }


def table(rows):
    shares = np.array([row["within_two"] for row in rows])
    asked = [row for row in rows if row["cause"] != "none"]
    return {
        "logs": len(rows),
        "bias within two standard deviations, share of samples and axes": round(float(shares.mean()), 3),
        "the same, worst log": round(float(shares.mean(1).min()), 3),
        "logs whose median error is beyond three on any axis": sum(row["median_miss"] > 3 for row in rows),
        "mass within three standard errors": sum(abs(row["mass_stderrs_off"]) < 3 for row in rows),
        "largest error of the mass, percent": max(abs(row["mass_percent_off"]) for row in rows),
        "the cause alone among what is kept": sum(row["found"] == [row["cause"]] for row in asked),
        "nothing kept although there is a cause": sum(not row["found"] for row in asked),
        "causes asked for": len(asked),
        "kept without a cause": sum(bool(row["found"]) for row in rows if row["cause"] == "none"),
    }


def main():
    seed, rows = by_rows(one, __doc__, 24)
    from common import keep  # imported late, because it sets flags of JAX that the diagnosis should choose itself

    keep(__file__, {"seed": seed, "table": table(rows), "rows": rows})


if __name__ == "__main__":
    main()
