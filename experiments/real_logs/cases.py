"""The recorded logs: where they are, and a least-squares tool for setups without a measured one."""

import os
from dataclasses import replace
from functools import partial
from pathlib import Path

import jax
import numpy as np

import ftbias_jax as ft
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.model.wrench.tool_wrench import motion_and_wrench, tool_parameters

KUKA_RUNS = ("base", "vib", "contact")
ROUNDS = 5
"""Repetitions of least squares, because the torque of the inertia depends slightly on the centre of mass."""


def folder():
    """Folder of the recorded logs, or None if it is missing."""
    shared = os.environ.get("FTBIAS_SHARED")
    real = Path(shared) / "data" / "real" if shared else None
    return real if real and real.is_dir() else None


def kuka(real, run, motion="orientation_only"):
    """Setup and log of one of KUKA_RUNS; with motion "specific_force" the accelerometer is used, too."""
    setup = ft.load_setup(real / "kuka_ati" / f"{motion}.toml")
    return setup, ft.read_log(real / "kuka_ati" / f"merged_{run}.csv", setup)


def panda(real, number):
    """Setup, whose tool is a guess, and one log."""
    setup = ft.load_setup(real / "panda_optoforce" / "setup.toml")
    return setup, ft.read_log(real / "panda_optoforce" / f"log_{number}.npz", setup)


def abb(real):
    setup = ft.load_setup(real / "abb_frida.toml")
    return setup, ft.read_log(real / "abb_frida.npz", setup)


def with_least_squares_tool(setup, result):
    """Setup with mass and centre of mass from plain least squares: reading = D theta - constant bias.

    Args:
        setup: setup of the log; its inertia is kept, because hardly any log constrains it.
        result: result of filtering the log, for its smoothed joints or pose.
    """
    params = params_from_setup(setup)
    one = partial(motion_and_wrench, params.arm, params.gravity)

    @jax.jit
    @partial(jax.vmap, in_axes=(None, 0, 0, 0))
    def data(theta, q, dq, ddq):
        return jax.jacobian(lambda x: one(x, q, dq, ddq)[1])(theta)

    D = np.asarray(data(params.theta, result.q, result.dq, result.ddq))
    reading = result.wrench_unbiased - result.bias
    rows = np.isfinite(reading).all(1)
    columns = np.concatenate([D[rows, :, :4], np.broadcast_to(-np.eye(6), (rows.sum(), 6, 6))], axis=2)
    weight = 1 / setup.sensor.noise_std
    found = np.array([setup.tool.mass, *(setup.tool.mass * setup.tool.center_of_mass), *np.zeros(6)])
    for _ in range(ROUNDS):
        inertia = np.asarray(tool_parameters(found[0], found[1:4] / found[0], setup.tool.inertia))[4:]
        left = (reading[rows] - D[rows, :, 4:] @ inertia) * weight
        found = np.linalg.lstsq((columns * weight[:, None]).reshape(-1, 10), left.ravel(), rcond=None)[0]
    return replace(setup, tool=replace(setup.tool, mass=float(found[0]), center_of_mass=found[1:4] / found[0]))
