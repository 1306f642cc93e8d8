"""`ftbias calibrate` on recorded logs, from a draft and from wrong tools, tested on unseen parts or logs.

FTBIAS_SHARED=FOLDER python experiments/real_logs/calibrate.py writes calibrate.json beside this script.
"""

import csv
import json
import os
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import ftbias_jax as ft
from ftbias_jax.commissioning.drafted import checked_draft
from ftbias_jax.commissioning.judged import baselines, judge
from ftbias_jax.io.draft.draft import Request

HERE = Path(__file__).parent
FIT = 100.0
"""s at the start of the log of the Axia80 to calibrate on; the rest is the test."""
MASSES = (None, 0.9, 1.0, 1.3)
"""kg: masses of the tool to start from; None = as drafted."""
TARE = "tare of the first 0.5 s"


def main():
    real = Path(os.environ.get("FTBIAS_SHARED", "shared")) / "data" / "real"
    if not real.is_dir():
        print(f"skipped: no recorded logs in {real}")
        return
    with tempfile.TemporaryDirectory() as folder:
        found = {"axia80": axia(real, Path(folder)), "panda": panda(real)}
    (HERE / "calibrate.json").write_text(json.dumps(found, indent=1) + "\n")


def axia(real, folder):
    """Calibrate on the raw table with a header, from the tool of the draft and from other masses."""
    first, rest = cut(real / "axia80" / "motion.csv", folder)
    setup = checked_draft(Request(logs=[str(first)])).setup
    return {name(mass): road(with_mass(setup, mass), [first], rest) for mass in MASSES}


def panda(real):
    """Test each of two logs with the setup calibrated on the other, from the stated tool of 1 kg."""
    folder = real / "panda_optoforce"
    setup = ft.load_setup(folder / "setup.toml")
    logs = [folder / f"log_{i}.npz" for i in (1, 2)]
    return {
        f"log {i + 1} to log {2 - i}, {name(1.0)}": road(with_mass(setup, 1.0), [logs[i]], logs[1 - i]) for i in (0, 1)
    }


def cut(table, folder):
    with open(table, newline="") as file:
        head, *rows = csv.reader(file)
    begin = float(rows[0][0])
    parts = folder / "first.csv", folder / "rest.csv"
    for part, is_rest in zip(parts, (False, True), strict=True):
        with open(part, "w", newline="") as file:
            csv.writer(file).writerows([head, *(row for row in rows if (float(row[0]) - begin > FIT) == is_rest)])
    return parts


def name(mass):
    return "as given" if mass is None else f"from {mass:g} kg"


def with_mass(setup, mass):
    if mass is None:
        return setup
    return replace(setup, tool=replace(setup.tool, mass=mass, mass_std=None, center_of_mass_std=None))


def road(setup, paths, test):
    """Calibrate on some logs, with the bias at their end, and score predictions on another log."""
    begin = time.perf_counter()
    found = ft.calibrate(setup, [ft.read_log(path, setup, raw=True) for path in paths], bias=True)
    seconds = time.perf_counter() - begin
    unseen = [ft.read_log(test, setup)]
    judged = judge(found.setup, unseen, 1.0)
    held = baselines(judged)[TARE]
    tool = found.setup.tool
    print(f"{test.name}: {tool.mass:.4f} kg, {seconds:.0f} s", file=sys.stderr)
    return {
        "seconds": round(seconds),
        "steps": [[step.name, "kept" if step.kept else "not kept", step.why] for step in found.steps],
        "mass": [rounded(tool.mass), rounded(tool.mass_std)],
        "test, rms 1 s and 10 s ahead": rounded(judged.rms),
        "held tare": rounded(held.rms),
        "inside 95 %": rounded(judged.coverage),
        "used": rounded((judged.used == 1).mean()),
    }


def rounded(x):
    if x is None:
        return None
    numbers = np.asarray(x, float)
    return [rounded(y) for y in numbers] if numbers.ndim else float(f"{numbers:.4g}")


if __name__ == "__main__":
    main()
