"""Test of whether another drive is equivalent in one log: it predicts the extra wrench on held-out blocks."""

from __future__ import annotations

import numpy as np

from validation.generator.arms import Floats
from validation.generator.effects.effect import Scene
from validation.generator.world import ToolPath, tool_path

ENOUGH = 0.9
"""Share of the extra wrench's mean square that an equivalent drive has to predict."""
RATE = 20.0  # Hz at which series are compared
BLOCK, FOLDS = 1.0, 4  # s; each fold, every fourth block, is predicted from the others


def says_the_same(drive: str, extra: Floats, scene: Scene) -> bool:
    """Whether the drive, fitted to each sensor axis, predicts the extra wrench (T, 6) at the stamps of the scene.

    Args:
        drive: "joint_velocity", "angular_velocity" or "orientation".
        extra: extra wrench, N, Nm.
        scene: scene with the motion.
    """
    every = max(round(scene.rate / RATE), 1)
    t = scene.stamps[::every]
    series = _SERIES[drive](t, scene)
    return predicted_share(t, series, extra[::every] / scene.belief.noise_std) >= ENOUGH


def predicted_share(t: Floats, series: Floats, wrench: Floats) -> float:
    """Share of the mean square of a detrended wrench (T, 6) that series (T, k) predict on held-out blocks."""
    line = np.stack([np.ones(len(t)), t / (1 + t[-1])], 1)
    columns = np.concatenate([line, series / np.maximum(np.abs(series).max(0), 1e-12)], 1)
    fold = (t // BLOCK).astype(int) % FOLDS
    left = np.empty_like(wrench)
    for k in range(FOLDS):
        rest = fold != k
        found = np.linalg.lstsq(columns[rest], wrench[rest], rcond=1e-6)[0]
        left[~rest] = wrench[~rest] - columns[~rest] @ found
    whole = wrench - line @ np.linalg.lstsq(line, wrench, rcond=None)[0]
    return float(1 - (left**2).sum() / max((whole**2).sum(), 1e-300))


def _joint_velocity(t: Floats, scene: Scene) -> Floats:
    dq = scene.motion(t)[1]
    return np.concatenate([dq, dq * np.abs(dq), np.tanh(dq / 0.02)], 1)


def _angular_velocity(t: Floats, scene: Scene) -> Floats:
    path = tool_path(scene.world, scene.motion, scene.grid)
    fine = np.einsum("tij,ti->tj", path.rotation, path.angular_velocity())
    omega = np.stack([np.interp(t, scene.grid, x) for x in fine.T], 1)
    return np.concatenate([omega, omega * np.abs(omega), np.tanh(omega / 0.02)], 1)


def _orientation(t: Floats, scene: Scene) -> Floats:
    path: ToolPath = tool_path(scene.world, scene.motion, t)
    x, y, z = (path.rotation.transpose(0, 2, 1) @ scene.belief.gravity / np.linalg.norm(scene.belief.gravity)).T
    second = np.stack([x * y, x * z, y * z, x * x, y * y], 1)
    return np.concatenate([path.rotation.reshape(len(t), 9), second], 1)


_SERIES = {"joint_velocity": _joint_velocity, "angular_velocity": _angular_velocity, "orientation": _orientation}
