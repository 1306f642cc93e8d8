"""From a recording to a diagnosis in four commands without an editor: setup, identify or check, filter, diagnose.

Twelve logs are simulated (``made.py``) and four are recorded; the recorded ones are left out if the environment
variable FTBIAS_SHARED does not name a folder with data/real.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from common import keep
from made import logs, truth

import ftbias_jax as ft

COMMAND = [sys.executable, "-c", "import sys; from ftbias_jax.cli.main import main; sys.exit(main())"]
CASES = {
    "UR10e, its own sensor: a ROS bag at rest, tool unknown": (["ur10e_pick.bag"], ["--robot", "ur10e"]),
    "KUKA and ATI: three CSV files, microseconds, g": (
        [f"kuka_ati/1-baseline_{stream}.csv" for stream in ("wrench", "orientations", "accel")],
        [],
    ),
    "Panda and OptoForce: arrays in conventions of their own": (["panda_optoforce/log_1_as_stored.npz"], []),
    "ATI Axia80: a table of poses at 10 Hz": (["axia80/motion.csv"], []),
}
"""Recorded logs: name -> (files, options of ``ftbias setup``)."""


def run(words, real, folder):
    """Run one command; return its exit code, processor time and output, with folders removed from the paths."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([*COMMAND, *map(str, words)], cwd=folder, capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, 1)
    printed = (done.stdout + done.stderr).replace(f"{real}/", "").replace(f"{folder}/", "").splitlines()
    printed = [line for line in printed if "% after" not in line and ", looking" not in line]
    shown = " ".join(str(word).replace(f"{real}/", "").replace(f"{folder}/", "") for word in words)
    print(f"$ ftbias {shown}", *printed, f"(exit code {done.returncode}, {seconds} s of the processor)", "", sep="\n")
    return {"command": f"ftbias {shown}", "exit_code": done.returncode, "cpu_seconds": seconds, "printed": printed}


def run_commands(files, options, real, folder):
    """Run the four commands on a log; the tool is identified only if the draft contains an estimate of it."""
    runs = [run(["setup", *files, *options, "-o", "setup.toml"], real, folder)]
    found = Path(folder, "setup.toml").exists() and not ft.load_setup(Path(folder, "setup.toml")).tool.unknown
    setup = "identified.toml" if found else "setup.toml"
    stated = [files[0], "--setup", "setup.toml"]
    commands = [
        ["identify", *stated, "-o", setup] if found else ["check", *stated],
        ["filter", files[0], "--setup", setup, "-o", "out.npz"],
        ["diagnose", files[0], "--setup", setup, "--json", "diagnosis.json"],
    ]
    runs += [run(words, real, folder) for words in commands]
    found = {"commands": runs, "result": numbers(Path(folder, setup)) if Path(folder, "out.npz").exists() else {}}
    answer = Path(folder, "diagnosis.json")
    return found | ({"diagnosis": json.loads(answer.read_text())["sentence"]} if answer.exists() else {})


def numbers(path):
    """Return the main values of the setup, and the scatter of the reading before and after compensation."""
    setup = ft.load_setup(path)
    with np.load(path.parent / "out.npz") as result:
        raw = result["wrench_unbiased"] - result["bias"]
        left = result["wrench_unbiased"] - result["wrench_tool"]
        found = {"samples": len(result["t"])}
        found["std_raw_N"], found["std_left_N"] = (
            [round(float(x), 3) for x in np.nanstd(values[:, :3], axis=0)] for values in (raw, left)
        )
        found["bias_std_at_the_end_N"] = [round(float(x), 3) for x in result["bias_std"][-1, :3]]
    known = {name: getattr(setup.sensor, name) for name in ("reports", "compensated", "rezeroed")}
    if not setup.tool.unknown:
        known |= {"mass_kg": setup.tool.mass, "center_of_mass_m": [float(x) for x in setup.tool.center_of_mass]}
    return {**found, "not_known": list(setup.tool.unknown), **known}


def is_read(file, folder, expected):
    """Whether the log read with the drafted setup has the right wrench (N, Nm, sensor axes, sign) and joints (rad)."""
    if not (folder / "setup.toml").exists():
        return False
    log = ft.read_log(file, ft.load_setup(folder / "setup.toml"), raw=True)
    _, _, q, *_ = truth()
    same = log.wrench.shape == expected.shape and np.allclose(log.wrench, expected, rtol=1e-4, atol=1e-3)
    return bool(same and np.allclose(log.q, q, atol=1e-6))


def main():
    results = {}
    shared = os.environ.get("FTBIAS_SHARED")
    real = Path(shared, "data", "real").resolve() if shared else None
    if real is None or not real.is_dir():
        print("recorded logs are left out: FTBIAS_SHARED names no folder with data/real")
    else:
        for name, (files, options) in CASES.items():
            with tempfile.TemporaryDirectory() as folder:
                results[name] = run_commands([real / file for file in files], options, real, folder)
    with tempfile.TemporaryDirectory() as made:
        for name, files, options, expected in logs(Path(made)):
            with tempfile.TemporaryDirectory() as folder:
                found = run_commands(files, options, made, folder)
                results[name] = {**found, "read_as_it_is": is_read(files[0], Path(folder), expected)}
    right = [not any(x["exit_code"] for x in found["commands"]) for found in results.values()]
    as_it_is = [found["read_as_it_is"] for found in results.values() if "read_as_it_is" in found]
    print(f"{sum(right)} of {len(right)} without an error, {sum(as_it_is)} of {len(as_it_is)} read as they are")
    keep(__file__, results)


if __name__ == "__main__":
    main()
