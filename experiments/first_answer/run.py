"""From a recording to an answer in three commands without an editor: ``ftbias setup``, ``check`` and ``filter``.

Skips if the environment variable FTBIAS_SHARED does not name a folder with data/real.
"""

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from common import keep

import ftbias_jax as ft

COMMAND = [sys.executable, "-c", "import sys; from ftbias_jax.cli.main import main; sys.exit(main())"]
CASES = {
    "UR10e, its own sensor: a ROS bag at rest, tool unknown": (["ur10e_pick.bag"], ["--robot", "ur10e"]),
    "KUKA and ATI: three CSV files, microseconds, g": (
        [f"kuka_ati/1-baseline_{stream}.csv" for stream in ("wrench", "orientations", "accel")],
        [],
    ),
    "Panda and OptoForce: arrays in conventions of their own": (["panda_optoforce/log_1_as_stored.npz"], []),
}


def run(words, real, folder):
    """Exit code, processor time and printed lines of one command; paths become names."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([*COMMAND, *map(str, words)], cwd=folder, capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, 1)
    printed = [
        line for line in (done.stdout + done.stderr).replace(f"{real}/", "").splitlines() if "% after" not in line
    ]
    shown = " ".join(str(word).replace(f"{real}/", "") for word in words)
    print(f"$ ftbias {shown}", *printed, f"(exit code {done.returncode}, {seconds} s of the processor)", "", sep="\n")
    return {"command": f"ftbias {shown}", "exit_code": done.returncode, "cpu_seconds": seconds, "printed": printed}


def numbers(folder):
    """What the drafted setup states, and how much of the reading's scatter is left when it is corrected."""
    setup = ft.load_setup(folder / "setup.toml")
    with np.load(folder / "out.npz") as result:
        raw = result["wrench_unbiased"] - result["bias"]
        left = result["wrench_unbiased"] - result["wrench_tool"]
        found = {"samples": len(result["t"])}
        found["std_raw_N"], found["std_left_N"] = (
            [round(float(x), 3) for x in np.nanstd(values[:, :3], axis=0)] for values in (raw, left)
        )
        found["bias_std_at_the_end_N"] = [round(float(x), 3) for x in result["bias_std"][-1, :3]]
    unknown = list(setup.tool.unknown)
    known = {} if unknown else {
        "mass_kg": setup.tool.mass, "center_of_mass_m": [float(x) for x in setup.tool.center_of_mass]
    }  # fmt: skip
    return {**found, "not_known": unknown, **known, "reports": setup.sensor.reports}


def main():
    """Every case in a folder of its own."""
    shared = os.environ.get("FTBIAS_SHARED")
    real = Path(shared, "data", "real").resolve() if shared else None
    if real is None or not real.is_dir():
        print("skipped: FTBIAS_SHARED names no folder with data/real")
        return
    results = {}
    for name, (files, options) in CASES.items():
        logs = [real / file for file in files]
        with tempfile.TemporaryDirectory() as folder:
            commands = [
                ["setup", *logs, *options, "-o", "setup.toml"],
                ["check", logs[0], "--setup", "setup.toml"],
                ["filter", logs[0], "--setup", "setup.toml", "-o", "out.npz"],
            ]
            runs = [run(words, real, folder) for words in commands]
            results[name] = {"commands": runs, "result": numbers(Path(folder))}
    keep(__file__, results)


if __name__ == "__main__":
    main()
