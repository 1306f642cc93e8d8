"""How often the right mistake is named, and how often a right setup is suspected; simulated and recorded logs."""

import argparse
import os
import sys
import time
from pathlib import Path

import numpy as np

import ftbias_jax as ft
from ftbias_jax.model.effects.catalogue import CATALOGUE

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parent)]
import logs  # noqa: E402
import mistakes  # noqa: E402
from common import keep  # noqa: E402
from recorded import recorded_logs  # noqa: E402

SEEDS = int(os.environ.get("S", 4))
"""Logs of each shape; five shapes make 20 logs."""
RIGHT = 8
"""Logs with each effect of the catalogue."""


def check(tables, arrays):
    """Names of what was found, and the seconds it took."""
    setup = ft.parse_setup(tables)
    log = ft.Log.from_arrays(setup, **{"q": None, **arrays})
    start = time.perf_counter()
    found = ft.check_setup(setup, [log])
    return [finding.mistake for finding in found.findings], time.perf_counter() - start


def count(table, name, expected, found):
    """One more log in a table of name -> [right, all, {what else was said: how often}]."""
    row = table.setdefault(name, {"expected": expected, "right": 0, "logs": 0, "instead": {}})
    row["logs"] += 1
    if (found[0] if found else "none") == expected:
        row["right"] += 1
    else:
        words = " ".join(found) or "none"
        row["instead"][words] = row["instead"].get(words, 0) + 1


def simulated_mistakes(seconds):
    """Every mistake on 20 logs."""
    table = {}
    for number, shape in enumerate(logs.SHAPES):
        for seed in range(SEEDS):
            rng = np.random.default_rng(1000 * number + seed)
            tables, arrays = logs.simulated(shape, 100 * number + seed)
            pose = logs.as_pose(tables, arrays, rng)
            for changes, right in ((mistakes.MISTAKES, (tables, arrays)), (mistakes.POSE_MISTAKES, pose)):
                for name, (expected, change) in {"right setup": ("none", nothing), **changes}.items():
                    found, took = check(*mistakes.mistaken(change, *right, rng))
                    seconds.append(took)
                    count(table, name, expected, found)
        print(shape, flush=True)
    return table


def right_setups(seconds):
    """Every effect of the catalogue at its typical size, and strong drift: nothing is to be found."""
    table = {}
    for name in [*CATALOGUE, "strong drift"]:
        for seed in range(RIGHT):
            effects = {} if name == "strong drift" else {name: {}}
            change = strong_drift if name == "strong drift" else None
            tables, arrays = logs.simulated(logs.EFFECT_SHAPE, 5000 + seed, effects, change)
            found, took = check(tables, arrays)
            seconds.append(took)
            count(table, name, "none", found)
        print(name, flush=True)
    return table


def recorded(seconds):
    """Recorded logs as they are, as published, and with every mistake; None where they are not there."""
    found_logs = recorded_logs()
    if not found_logs:
        return None
    as_they_are, table = {}, {}
    for name, tables, arrays, expected in found_logs:
        found, took = check(tables, arrays)
        seconds.append(took)
        as_they_are[name] = {"expected": expected, "found": found or ["none"]}
        if expected != ["none"]:
            continue
        rng = np.random.default_rng(0)
        pose = "sensor_pose" in tables
        changes = {n: c for n, c in mistakes.MISTAKES.items() if not pose or n in ON_POSES}
        changes |= {n: c for n, c in mistakes.POSE_MISTAKES.items() if pose and mistakes.applies(n, tables, arrays)}
        for mistake, (expected_name, change) in changes.items():
            found, took = check(*mistakes.mistaken(change, tables, arrays, rng))
            seconds.append(took)
            count(table, mistake, expected_name, found)
            if found[:1] != [expected_name]:
                print(name, mistake, found, flush=True)
    return {"as they are": as_they_are, "with mistakes": table}


ON_POSES = [  # those that need no joints
    name
    for name in mistakes.MISTAKES
    if not name.endswith("degrees") and "compensated" not in name and "base frame" not in name
]


def nothing(tables, arrays, rng):
    """The setup is right."""


def strong_drift(tables):
    tables["bias"] = {"noise_density": [0.02, 1e-3], "initial_drift_std": [0.1, 5e-3]}


def total(table):
    """Right and all."""
    return [sum(row["right"] for row in table.values()), sum(row["logs"] for row in table.values())]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--part", choices=["simulated", "right", "recorded"])
    part = parser.parse_args().part
    seconds, result = [], {}
    for name, work in (("simulated", simulated_mistakes), ("right", right_setups), ("recorded", recorded)):
        if part in (None, name):
            result[name] = work(seconds)
            for table in [result[name], (result[name] or {}).get("with mistakes")]:
                for mistake, row in (table or {}).items():
                    if "logs" in row:
                        print(f"{mistake:34s} {row['right']:3d} of {row['logs']:3d}  {row['instead'] or ''}")
    result["seconds"] = {"median": round(float(np.median(seconds)), 3), "most": round(max(seconds), 3)}
    for name in ("simulated", "right"):
        if name in result:
            result[f"{name}, right of all"] = total(result[name])
    print(result["seconds"], {k: v for k, v in result.items() if k.endswith("all")})
    if part is None:
        keep(__file__, result)


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
