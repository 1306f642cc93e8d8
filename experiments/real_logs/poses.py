"""The tool of the Axia80 from its 100 static poses, by identify and by plain least squares."""

import json
import os
import tempfile
from pathlib import Path

import numpy as np

import ftbias_jax as ft

SETUP = {
    "sensor_pose": {"orientation": "quaternion_xyzw", "linear": "none", "orientation_noise_std": 1e-4},
    "log": {"wrench_axes": "base"},
    "sensor": {"noise_std": [0.01, 0.0005], "reports": "wrench_on_sensor"},
    "tool": {"mass": 1.0, "center_of_mass": [0, 0, 0.05], "inertia": [2e-3, 0, 0, 2e-3, 0, 1e-3]},
}
TRUTH, STDERR = 1.1585, 0.0025
"""kg: mass and its standard error from all other methods."""


def main():
    folder = Path(os.environ["FTBIAS_SHARED"]) / "data" / "real" / "axia80"
    poses, wrench = (np.loadtxt(folder / name, delimiter=",") for name in ("poses_100.txt", "wrench_100.txt"))
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "poses.csv"
        header = "qx,qy,qz,qw,fx,fy,fz,tx,ty,tz"
        np.savetxt(path, np.hstack([poses[:, 3:], wrench]), delimiter=",", header=header, comments="")
        setup = ft.parse_setup(SETUP)
        found = ft.identify_tool(setup, ft.read_poses(path, setup))
    mass, stderr = float(found.tool.values[0]), float(found.tool.stderr[0])
    result = {
        "mass_kg": round(mass, 4),
        "stderr_kg": round(stderr, 4),
        "off_in_standard_errors": round((mass - TRUTH) / float(np.hypot(stderr, STDERR)), 2),
        "errors_enlarged": round(found.poses.enlarged, 1),
        "plain_least_squares_kg": round(float(found.poses.plain[0]), 4),
    }
    print(result)
    Path(__file__).with_suffix(".json").write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
