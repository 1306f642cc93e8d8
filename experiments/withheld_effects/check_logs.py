#!/usr/bin/env python3
"""Checks of the generator: MuJoCo against Newton-Euler equations in NumPy, and logs against their labels.

python check_logs.py            physics: nominal wrenches, static weight, a cable, an external force
python check_logs.py OUT        the same, then: logs against setup and label, gap of every effect
"""

from __future__ import annotations

import copy
import json
import sys
import tomllib
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import savgol_filter
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parents[1]))
from validation.generator.arms import Floats, panda
from validation.generator.motion import KINDS, random_motion
from validation.generator.nominal_model import Tool, random_belief
from validation.generator.world import Cable, cable_length, nominal_world, time_grid, wrench

STATIC_LINEAR_EFFECTS = {
    "none",
    "tool_mass",
    "tool_com",
    "tool_inertia",
    "gravity_tilt",
    "encoder_offset",
    "mount_rotation",
}
STATIC_LINEAR_EFFECTS |= {"gain", "crosstalk"}


def sensor_poses(axes: Floats, points: Floats, zero: tuple[Floats, Floats], q: Floats) -> tuple[Floats, Floats]:
    """Rotations (T, 3, 3) and positions (T, 3) m of the sensor for q (T, n) rad, by successive turns about the axes.

    Args:
        axes: (n, 3) directions of the joint axes at q = 0.
        points: (n, 3) m, points on the joint axes at q = 0.
        zero: position (3,) m and rotation (3, 3) of the sensor at q = 0.
        q: (T, n) rad, joint positions.
    """
    position, rotation = np.tile(zero[0], (len(q), 1)), Rotation.from_matrix(np.tile(zero[1], (len(q), 1, 1)))
    for axis, point, angle in list(zip(axes, points, q.T, strict=True))[::-1]:
        turn = Rotation.from_rotvec(angle[:, None] * axis)
        position, rotation = point + turn.apply(position - point), turn * rotation
    return rotation.as_matrix(), position


def newton_euler(rotation: Floats, position: Floats, tool: Tool, gravity: Floats, dt: float) -> Floats:
    """Wrench (T, 6) the sensor exerts on the tool, sensor frame: force = d momentum / dt, torque = d spin / dt."""
    center = position + rotation @ tool.com
    rate = _derivative(rotation, dt) @ rotation.transpose(0, 2, 1)  # [omega]
    omega = np.stack([rate[:, 2, 1], rate[:, 0, 2], rate[:, 1, 0]], 1)
    spin = np.einsum("tij,jk,tlk,tl->ti", rotation, tool.inertia, rotation, omega)
    force = tool.mass * (_derivative(_derivative(center, dt), dt) - gravity)
    torque = _derivative(spin, dt) + np.cross(center - position, force)
    return np.concatenate([np.einsum("tji,tj->ti", rotation, x) for x in (force, torque)], 1)


def _derivative(x: Floats, dt: float) -> Floats:
    """Fourth-order central difference along the first axis; the two values at either end are invalid."""
    return (8 * (np.roll(x, -1, 0) - np.roll(x, 1, 0)) - np.roll(x, -2, 0) + np.roll(x, 2, 0)) / (12 * dt)


def check_physics(seeds: int = 8) -> None:
    """Compare nominal wrenches of random robots by both methods; prints the largest relative difference."""
    worst = 0.0
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        belief = random_belief(rng)
        motion = random_motion(KINDS[seed % 2], belief.arm, 8.0, 1.5, rng)
        world, t = nominal_world(belief), time_grid(8.0)
        simulated = wrench(world, motion, t)
        flange, arm = belief.arm.flange_rotation, belief.arm
        zero = arm.flange_position + flange @ world.mount_position, flange @ world.mount_rotation
        rotation, position = sensor_poses(arm.axes, arm.points, zero, motion(t)[0])
        expected = newton_euler(rotation, position, belief.tool, belief.gravity, t[1] - t[0])
        inner = slice(5, -5)
        difference = np.abs(simulated - expected)[inner] / np.abs(expected[inner]).max(0)
        worst = max(worst, float(np.quantile(difference, 0.98)))  # finite differences are wrong where the jerk jumps
    print(f"MuJoCo against Newton-Euler, {seeds} robots: largest relative difference {worst:.1e}")
    assert worst < 1e-6


def check_static() -> None:
    """Check the reading at rest: +m g along z with the sensor upright, minus external forces and cable pull."""
    belief = replace(random_belief(np.random.default_rng(0)), arm=panda(), gravity=np.array([0, 0, 9.81]))
    world = replace(nominal_world(belief), mount_rotation=np.eye(3))  # flange z points against gravity

    def still(t: Floats) -> tuple[Floats, Floats, Floats]:
        return np.zeros((len(t), 7)), np.zeros((len(t), 7)), np.zeros((len(t), 7))

    t = np.array([0.0, 1e-3])
    bare = wrench(world, still, t)[0]
    print("upright at rest, reading / weight:", (bare[:3] / (9.81 * belief.tool.mass)).round(9))
    assert np.allclose(bare[:3], [0, 0, 9.81 * belief.tool.mass], atol=1e-9)
    pushed = wrench(replace(world, loads=(lambda path: (0 * path.position + [0, 0, 2.0], path.position),)), still, t)[0]
    assert np.allclose(pushed - bare, [0, 0, 2.0, 0, 0, 0], atol=1e-9)  # base z is minus sensor z: -R^T F
    cable = Cable(50.0, 0.1, belief.arm.flange_position - np.array([0, 0, 0.5]), False, np.zeros(3))
    held = replace(world, cables=(cable,))
    pull = np.linalg.norm((wrench(held, still, t)[0] - bare)[:3])
    length = cable_length(held, still, t)[0]
    print(f"cable: pull {pull:.6f} N, stiffness x stretch {50 * (length - 0.1):.6f} N")
    assert np.isclose(pull, 50 * (length - 0.1)), "this MuJoCo's force sensor leaves tendons out: use a newer one"


def expected_from_files(setup: dict[str, Any], q: Floats, dt: float) -> Floats:
    """Wrench (T, 6) on the tool that a setup file predicts for evenly spaced joint positions q (T, n)."""
    robot, sensor, tool = setup["robot"], setup["sensor"], setup["tool"]
    if "model" in robot:
        arm = panda()
        axes, points, place, turn = arm.axes, arm.points, arm.flange_position, arm.flange_rotation
    else:
        axes, points = (np.array([joint[key] for joint in robot["joints"]]) for key in ("axis", "point"))
        place = np.array(robot["flange"]["translation"])
        turn = Rotation.from_euler("xyz", robot["flange"]["rotation_rpy"]).as_matrix()
    mount = Rotation.from_euler("xyz", sensor["rotation_rpy"]).as_matrix()
    zero = place + turn @ sensor["translation"], turn @ mount
    xx, xy, xz, yy, yz, zz = tool["inertia"]
    body = Tool(tool["mass"], np.array(tool["center_of_mass"]), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    return newton_euler(*sensor_poses(axes, points, zero, q), body, np.array(robot["gravity"]), dt)


def with_labels_applied(
    setup: dict[str, Any], effects: dict[str, Any], q: Floats
) -> tuple[dict[str, Any], Floats, Floats]:
    """Apply static, linear labels; return setup, joint positions (T, n) rad and a matrix (6, 6) for the wrench."""
    setup, q, matrix = copy.deepcopy(setup), q.copy(), np.eye(6)
    for name, value in effects.items():
        match name:
            case "tool_mass":
                setup["tool"]["mass"] = value["mass"]
            case "tool_com":
                setup["tool"]["center_of_mass"] = value["com"]
            case "tool_inertia":
                setup["tool"]["inertia"] = value["inertia"]
            case "gravity_tilt":
                setup["robot"]["gravity"] = value["gravity"]
            case "encoder_offset":
                q[:, value["joint"] - 1] -= value["offset"]
            case "mount_rotation":
                matrix = np.kron(np.eye(2), Rotation.from_euler("xyz", value["rpy"]).as_matrix().T)
            case "gain":
                matrix = np.diag(value["gain"])
            case "crosstalk":
                matrix = np.array(value["matrix"])
    return setup, q, matrix


def residual_sigmas(folder: Path, name: str, label: dict[str, Any], effects: dict[str, Any]) -> Floats:
    """Rms (6,) of half-second means of reading + true bias - prediction by ``with_labels_applied``, in noise sigmas.

    White noise leaves 1 / sqrt(samples in half a second); the noise of differentiated encoder positions averages out.
    """
    setup = tomllib.loads((folder / f"{name}.toml").read_text())
    with np.load(folder / f"{name}.npz") as log:
        t, q, read = log["t"], log["q"], log["wrench"]
    sign = -1.0 if setup["sensor"]["reports"] == "wrench_on_sensor" else 1.0
    joints, seen = np.isfinite(q[:, 0]), np.isfinite(read[:, 0])
    dt = float(np.median(np.diff(t[joints])))
    window = max(7, round(0.3 / dt) // 2 * 2 + 1)
    smooth = savgol_filter(q[joints], window, 5, axis=0)
    setup, smooth, matrix = with_labels_applied(setup, effects, smooth)
    predicted = expected_from_files(setup, smooth, dt) @ matrix.T
    inside = seen & (t > 1) & (t < label["duration"] - 2)
    bias = np.array(label["bias_1hz"])
    both = [
        np.stack([np.interp(t[inside], x, y) for y in values.T], 1)
        for x, values in ((t[joints], predicted), (np.arange(len(bias)), bias))
    ]
    rest = sign * read[inside] + both[1] - both[0]
    blocks = np.array_split(rest, max(1, int(2 * np.ptp(t[inside]))))
    return np.sqrt(np.mean([block.mean(0) ** 2 for block in blocks], 0)) / label["sigma"]


def check_folder(folder: Path) -> None:
    """Print residuals of logs before and after applying static, linear labels, then every effect's gap by level."""
    labels = json.loads((folder / "truth.json").read_text())
    for name, label in sorted(labels.items(), key=lambda item: list(item[1]["effects"])):
        if set(label["effects"]) <= STATIC_LINEAR_EFFECTS:
            before, after = (
                residual_sigmas(folder, name, label, with_labels_applied)
                for with_labels_applied in ({}, label["effects"])
            )
            what = "+".join(f"{effect} {label['form'].get(effect, '')}" for effect in label["effects"])
            print(f"{name} {what:34s} {label['timeline']:20s} gap / sigma", before.round(2), "->", after.round(2))
    gaps = defaultdict(list)
    for label in labels.values():
        gaps["+".join(label["effects"])].append((label["level"], label["gap_sigmas"], "+".join(label["form"].values())))
    for effect, rows in sorted(gaps.items()):
        print(f"{effect:34s}", "  ".join(f"L{level} {gap:.2f} {form}" for level, gap, form in sorted(rows)))


if __name__ == "__main__":
    check_physics()
    check_static()
    for argument in sys.argv[1:]:
        check_folder(Path(argument))
