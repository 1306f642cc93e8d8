"""Detection rate of setup mistakes, and false alarms on right setups, on simulated and recorded logs."""

import argparse
import json
import os
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

import ftbias_jax as ft

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parent)]
import logs  # noqa: E402
import mistakes  # noqa: E402
import poses  # noqa: E402
from common import keep  # noqa: E402
from recorded import recorded_logs  # noqa: E402

from validation.generator.make import Limits, make_set  # noqa: E402

SEEDS = 4
"""Number of logs per shape; five shapes make 20 logs."""
POSE_SEEDS = 10
"""Number of sets of static poses per arm, for five arms."""
SEED = 1126
"""Seed of the first log of each kind; the check was developed with other seeds."""
RIGHT = 200
"""Number of logs whose setup is right except for effects."""


def check(tables, arrays):
    """Check the setup of a log; return the names of the findings, and the processor time in s."""
    setup = ft.parse_setup(tables)
    log = ft.Log.from_arrays(setup, **{"q": None, **arrays})
    start = time.process_time()
    found = ft.check_setup(setup, [log])
    return [finding.mistake for finding in found.findings], time.process_time() - start


def count(table, name, expected, found):
    """Count one more log in a table: name -> expected finding, right logs, all logs, {other findings: count}."""
    row = table.setdefault(name, {"expected": expected, "right": 0, "logs": 0, "instead": {}})
    row["logs"] += 1
    if (found[0] if found else "none") == expected:
        row["right"] += 1
    else:
        words = " ".join(found) or "none"
        row["instead"][words] = row["instead"].get(words, 0) + 1


def one_log(shape, number, seed):
    """Make every mistake with one log; return (name, expected finding, findings, seconds) of each."""
    rng = np.random.default_rng(1000 * number + seed)
    tables, arrays = logs.simulated(shape, 100 * number + seed)
    pose = logs.as_pose(tables, arrays, rng)
    rows = []
    for changes, right in ((mistakes.MISTAKES, (tables, arrays)), (mistakes.POSE_MISTAKES, pose)):
        for name, (expected, change) in {"right setup": ("none", nothing), **changes}.items():
            rows.append((name, expected, *check(*mistakes.mistaken(change, *right, rng))))
    return rows


def simulated_mistakes(seconds, jobs=1, first=SEED):
    """Make every mistake with 20 logs, in ``jobs`` processes; return the table of counts."""
    table = {}
    tasks = [(shape, number, seed) for number, shape in enumerate(logs.SHAPES) for seed in range(first, first + SEEDS)]
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        for task, rows in zip(tasks, pool.map(one_log, *zip(*tasks, strict=True)), strict=True):
            print(*task, flush=True)
            for name, expected, found, took in rows:
                seconds.append(took)
                count(table, name, expected, found)
                if found[:1] != [expected] and (found or expected != "none"):
                    print("   ", name, found, flush=True)
    return table


def static_poses(seconds, first=SEED):
    """Make every mistake that readings at rest can show, on five arms; count those named first, or listed as alike."""
    table = {}
    for arm in poses.ARMS:
        for seed in range(first, first + POSE_SEEDS):
            tables, arrays = poses.simulated(arm, seed)
            for name, (expected, change) in {"right setup": ("none", nothing), **poses.mistakes_of(tables)}.items():
                wrong = mistakes.mistaken(change, tables, arrays, np.random.default_rng(seed))
                findings, took = checked_poses(*wrong)
                seconds.append(took)
                alike = {other.mistake for finding in findings[:1] for other in finding.alike}
                found = [finding.mistake for finding in findings]
                count(table, name, expected, found)
                row = table[name]
                row["listed"] = row.get("listed", 0) + int(found[:1] != [expected] and expected in alike)
                if found[:1] != [expected] and (found or expected != "none"):
                    print(arm, seed, len(arrays["q"]), name, found, sorted(alike), flush=True)
    return table


def checked_poses(tables, arrays):
    """Check static poses; return the findings, and the processor time in s."""
    setup = ft.parse_setup(tables)
    given = ft.Poses.from_arrays(setup, **arrays)
    start = time.process_time()
    return ft.check_setup(setup, [given]).findings, time.process_time() - start


def right_setups(seconds, folders=(), seed=SEED):
    """Check right setups of MuJoCo logs with effects in or outside the catalogue, or none: nothing may be found."""
    if not folders:
        folders = [tempfile.mkdtemp()]
        make_set(Path(folders[0]), "all", RIGHT, seed, Limits((12.0, 25.0), (125.0, 200.0, 250.0, 400.0, 500.0), False))
    table = {}
    for path in sorted(path for folder in folders for path in Path(folder).glob("log_*.npz")):
        if not path.with_suffix(".toml").exists():  # the set is still being made
            continue
        setup = ft.load_setup(path.with_suffix(".toml"))
        log = ft.read_log(path, setup)
        start = time.process_time()
        found = [finding.mistake for finding in ft.check_setup(setup, [log]).findings]
        seconds.append(time.process_time() - start)
        count(table, "right setups", "none", found)
    return table


def recorded(seconds):
    """Check recorded logs as they are, as published, and with every mistake; None if there are no recorded logs."""
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


ON_POSES = [  # mistakes that need no joints
    name
    for name in mistakes.MISTAKES
    if not name.endswith("degrees") and "compensated" not in name and "joint" not in name and "base frame" not in name
]


def nothing(tables, arrays, rng):
    """Change nothing: the setup is right."""


def total(table):
    """Number of right findings, and number of logs."""
    return [sum(row["right"] for row in table.values()), sum(row["logs"] for row in table.values())]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--part", choices=["simulated", "poses", "right", "recorded"])
    parser.add_argument(
        "--sets", nargs="+", default=(), help="labelled logs of 'experiments/validation make', to make none"
    )
    parser.add_argument("--jobs", type=int, default=1, help="processes for the simulated logs")
    parser.add_argument("--seed", type=int, default=SEED, help="of the first log of each kind")
    arguments = parser.parse_args()
    part, seed = arguments.part, arguments.seed
    parts = {
        "simulated": partial(simulated_mistakes, jobs=arguments.jobs, first=seed),
        "poses": partial(static_poses, first=seed),
        "right": partial(right_setups, folders=arguments.sets, seed=seed),
        "recorded": recorded,
    }
    path = Path(__file__).parent / "result.json"
    result = {"seed": seed}
    for name, work in parts.items():
        if part in (None, name):
            seconds = []
            result[name] = work(seconds)
            result[f"seconds of a check, {name}"] = {
                "median": round(float(np.median(seconds)), 3),
                "most": round(max(seconds), 3),
            }
            for table in [result[name], (result[name] or {}).get("with mistakes")]:
                show(table or {})
            if name != "recorded":
                result[f"{name}, right of all"] = total(result[name])
    print({key: value for key, value in result.items() if key.endswith("all") or key.startswith("seconds")})
    known = json.loads(path.read_text())["result"] if path.exists() else {}  # parts may be run separately
    keep(__file__, known | result)


def show(table):
    for name, row in table.items():
        if "logs" in row:
            print(f"{name:34s} {row['right']:3d} of {row['logs']:3d}  {row['instead'] or ''}")


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
