"""A fleet's archive from end to end: written, filtered with kills and resumes, diagnosed, reported.

python experiments/fleet/run.py [--count 10000] [--diagnosed 200] [--kills 10] [--jobs 2] [--folder DIR]
"""

import argparse
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from ftbias_jax.check.motion import arm_motion, data_matrices
from ftbias_jax.check.regression import stated_tool
from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.fleet.alarms import alarms_of
from ftbias_jax.fleet.entry import Entry
from ftbias_jax.fleet.history import read_fleet
from ftbias_jax.fleet.manifest import Manifest, read_manifests
from ftbias_jax.fleet.table import save_table
from ftbias_jax.model.trajectories import working_range
from ftbias_jax.setup import dump_setup, parse_setup

SAMPLES, RATE = 1500, 100.0
FIRST, DAYS = 1_767_600_000.0, 180.0  # s since 1970, 2026-01-05; number of days
AGED = np.array([0.0, 0.0, 2.0, 0.0, 0.0, 0.0])  # N, Nm: drift of the second robot's bias until the end
HEAVIER = 0.1  # kg, added to the tool of the second robot in the second half
PROGRAM = "import sys; from ftbias_jax.cli.main import main; sys.exit(main())"
PACKAGE = Path(__file__).parents[2]


def write_logs(folder, count):
    """Write logs of two robots in time order, half each; the second robot's bias drifts and its tool gets heavier."""
    setup = parse_setup(SETUP)
    for robot in (1, 2):
        one = replace(setup, robot=replace(setup.robot, name=f"cell {robot}"))
        (folder / f"cell{robot}.toml").write_text(dump_setup(one))
        (folder / f"cell{robot}").mkdir()
        for number in range(count // 2):
            share = number / max(count // 2 - 1, 1)
            old = robot == 2
            mass = setup.tool.mass + HEAVIER * (old and share > 0.5)
            tool = replace(setup.tool, mass=mass)
            bias = np.array([2.0, -1.0, 3.0, 0.1, -0.2, 0.05]) + share * AGED * old
            arrays = make_log(replace(setup, tool=tool), bias, FIRST + share * DAYS * 86400, seed=(robot, number))
            np.savez(folder / f"cell{robot}" / f"{number:05d}.npz", **arrays)


def make_log(setup, bias, start, seed, samples=SAMPLES, rate=RATE):
    """Simulate a log with sines of all joints, and the wrench of the tool with bias and noise; return its arrays."""
    rng = np.random.default_rng(seed)
    t = np.arange(samples) / rate
    omega, phase = 2 * np.pi * rng.uniform(0.05, 0.2, (2, 7)), rng.uniform(0, 2 * np.pi, (2, 7))
    center, excursion = working_range(setup)
    angle, half = omega * t[:, None, None] + phase, 0.5 * excursion
    q = center + (half * np.sin(angle)).sum(1)
    dq, ddq = (half * omega * np.cos(angle)).sum(1), (-half * omega**2 * np.sin(angle)).sum(1)
    tool = stated_tool(setup.tool).theta
    wrench = data_matrices(arm_motion(setup.robot, setup.sensor, q, dq, ddq), setup.robot.gravity) @ tool
    noise = setup.sensor.noise_std * rng.normal(size=wrench.shape)
    walk = np.cumsum(setup.bias.noise_density / rate**1.5 * rng.normal(size=wrench.shape), 0)
    return {
        "t": start + t,
        "q": q + 2e-5 * rng.normal(size=q.shape),
        "dq": dq + 1e-3 * rng.normal(size=q.shape),
        "wrench": wrench - bias - np.cumsum(walk, 0) / rate + noise,
    }


def command(folder, *words):
    environment = {**os.environ, "PYTHONPATH": str(PACKAGE)}
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *words],
        cwd=folder,
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def finish(process):
    started = time.perf_counter()
    assert process.wait() in (0, 3)
    return time.perf_counter() - started


def cpu_seconds():
    """Processor time, s, of all ended child processes and their waited-for children."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def done(place):
    return len(read_manifests(str(place)).entries) if place.is_dir() else 0


def filter_with_kills(folder, robot, count, kills, jobs):
    """Filter a robot's logs; every run but the last is killed. Return total seconds, and the entries at each kill."""
    words = filter_words(robot, jobs)
    place, seconds, found = folder / "results" / f"cell{robot}", 0.0, []
    for kill in range(1, kills + 1):
        started, process = time.perf_counter(), command(folder, *words)
        while process.poll() is None and done(place) < count * kill / (kills + 1):
            time.sleep(max(0.5, count / 2500))  # polling costs time, too
        process.send_signal(signal.SIGTERM if kill % 2 else signal.SIGKILL)
        process.wait()
        seconds += time.perf_counter() - started
        found.append(done(place))
    return seconds + finish(command(folder, *words)), found


def manifest_seconds(place, count):
    """Processor time of the manifest alone for ``count`` logs: one line per log, then reading and the table."""
    contents = read_manifests(str(place))
    entries = [entry for entry in contents.entries.values() if entry.job == "filter"]
    with tempfile.TemporaryDirectory() as folder:
        started = time.process_time()
        with Manifest(str(Path(folder) / "manifest.filter.jsonl")) as manifest:
            for i in range(count):
                entry: Entry = entries[i % len(entries)]
                manifest.add_entry(entry._replace(output=f"{i}.npz"))
        lines = time.process_time() - started
        kept = list(read_manifests(folder).entries.values())
        save_table(str(Path(folder) / "manifest.filter.parquet"), kept, contents.settings)
        return {"lines": lines, "all": time.process_time() - started}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--diagnosed", type=int, default=200)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--folder", help="empty or new; kept (default: one that is removed)")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(arguments.folder or temporary)
        folder.mkdir(exist_ok=True)
        measure(folder, arguments)


def measure(folder, arguments):
    """Run and measure all steps; every command is a separate process."""
    count, half = arguments.count, arguments.count // 2
    started = time.perf_counter()
    write_logs(folder, count)
    result = {"logs": 2 * half, "samples": SAMPLES, "seconds_to_write_logs": round(time.perf_counter() - started, 1)}
    filtered, found = filter_with_kills(folder, 2, half, arguments.kills, arguments.jobs)
    before = cpu_seconds()
    filtered += finish(command(folder, *filter_words(1, arguments.jobs)))
    cpu = (cpu_seconds() - before) / half  # of runs without a kill
    again = [finish(command(folder, *filter_words(robot, arguments.jobs))) for robot in (1, 2)]  # nothing left to do
    entries = [e for robot in (1, 2) for e in read_manifests(str(folder / "results" / f"cell{robot}")).entries.values()]
    assert len(entries) == 2 * half
    manifests = [folder / "results" / f"cell{robot}" / "manifest.filter.jsonl" for robot in (1, 2)]
    twice = sum(line.startswith('{"log":') for path in manifests for line in path.read_text().splitlines()) - 2 * half
    manifest = manifest_seconds(folder / "results" / "cell2", 10_000)
    each = float(np.median([entry.seconds for entry in entries]))
    result |= {
        "filter": {
            "seconds_in_all": round(filtered, 1),
            "seconds_a_log": round(filtered / (2 * half), 4),
            "cpu_seconds_a_log": round(cpu, 3),
            "median_seconds_of_a_log_in_its_process": round(each, 4),
            "kills": arguments.kills,
            "done_at_each_kill": found,
            "statuses": counted(entry.status for entry in entries),
            "errors": sorted({entry.error for entry in entries if entry.error})[:5],
            "filtered_twice": twice,
            "seconds_to_find_that_all_is_done": round(sum(again), 1),
        },
        "manifest": {
            "cpu_seconds_for_10000_logs": {name: round(value, 2) for name, value in manifest.items()},
            "share_of_cpu": round(manifest["all"] / (1e4 * cpu), 5),
        },
    }
    print(json.dumps(result, indent=1), flush=True)
    if not arguments.diagnosed:
        return write_report(folder, result)
    chosen = [f"cell2/{i:05d}.npz" for i in np.linspace(0, half - 1, min(arguments.diagnosed, half)).astype(int)]
    words = ("diagnose", *chosen, "--setup", "cell2.toml", "-o", "results/cell2", "--jobs", str(arguments.jobs))
    before = cpu_seconds()
    seconds = finish(command(folder, *words))
    diagnosed = [e for e in read_manifests(str(folder / "results" / "cell2")).entries.values() if e.job == "diagnose"]
    result["diagnose"] = {
        "logs": len(diagnosed),
        "seconds_a_log": round(seconds / len(diagnosed), 2),
        "cpu_seconds_a_log": round((cpu_seconds() - before) / len(diagnosed), 2),
        "median_seconds_of_a_log_in_its_process": round(float(np.median([e.seconds for e in diagnosed])), 2),
        "verdicts": counted(e.quality.get("verdict", e.status) for e in diagnosed),
        "causes": counted(cause for e in diagnosed for cause in e.quality.get("causes", ())),
    }
    write_report(folder, result)


def write_report(folder, result):
    seconds = finish(command(folder, "report", "results", "-o", "fleet.html"))
    fleet = read_fleet([str(folder / "results")])
    alarms = {f"{group[0]}": [a.text for a in alarms_of(some)] for group, some in fleet.by_robot().items()}
    size = (folder / "fleet.html").stat().st_size
    result["report"] = {"seconds": round(seconds, 1), "page_kB": round(size / 1e3), "alarms": alarms}
    print(json.dumps(result, indent=1))
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from common import keep  # imported late, because it initialises JAX

    keep(__file__, result)


def filter_words(robot, jobs):
    return ("filter", f"cell{robot}", "--setup", f"cell{robot}.toml", "-o", f"results/cell{robot}", "--jobs", str(jobs))


def counted(words):
    every = list(words)
    return {word: every.count(word) for word in sorted(set(every))}


if __name__ == "__main__":
    main()
