"""Recorded logs as tables and arrays, so that the same mistakes can be applied to them."""

import os
import tomllib
from pathlib import Path

import numpy as np


def recorded_logs():
    """Return (name, tables, arrays, expected findings) of every recorded log with joints or poses; [] without any."""
    shared = os.environ.get("FTBIAS_SHARED")
    real = Path(shared) / "data" / "real" if shared else None
    if real is None or not real.is_dir():
        return []
    found = []
    tables = tomllib.loads((real / "abb_frida.toml").read_text())
    with np.load(real / "abb_frida.npz") as file:
        found.append(("ABB", tables, {name: file[name] for name in ("t", "q", "dq", "wrench")}, ["none"]))
    tables = tomllib.loads((real / "panda_optoforce" / "setup.toml").read_text())
    names = ("t", "orientation", "position", "angular_velocity", "wrench")
    conventions = ["quaternion_convention", "position_frame", "gyroscope_units"]
    for log in ("log_1", "log_2", "log_3", "log_1_as_stored"):
        with np.load(real / "panda_optoforce" / f"{log}.npz") as file:
            expected = conventions if log.endswith("stored") else ["none"]
            found.append((f"Panda {log}", tables, {name: file[name] for name in names}, expected))
    tables = tomllib.loads((real / "kuka_ati" / "orientation_only.toml").read_text())
    for run in ("base", "vib", "contact"):
        arrays = _kuka(real / "kuka_ati" / f"merged_{run}.csv")
        found.append((f"KUKA {run}", tables, arrays, ["none"]))
        published = {**tables, "sensor": {**tables["sensor"], "reports": "wrench_on_tool"}}
        found.append((f"KUKA {run} as published", published, arrays, ["sign"]))
    return found


def _kuka(path):
    """Read stamps, wrench and orientation from a CSV; NaN = not measured."""
    columns = np.genfromtxt(path, delimiter=",", names=True)
    wrench = np.stack([columns[name] for name in ("fx", "fy", "fz", "tx", "ty", "tz")], 1)
    matrix = np.stack([columns[f"r{i}{j}"] for i in "123" for j in "123"], 1).reshape(-1, 3, 3)
    return {"t": columns["t"], "wrench": wrench, "orientation": matrix}
