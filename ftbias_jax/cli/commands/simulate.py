"""``ftbias simulate``: a log as a robot would record it, and what is true about it in another file."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ftbias_jax.cli.repairs import tell_repairs
from ftbias_jax.errors import UsageError
from ftbias_jax.io import read_log
from ftbias_jax.io.atomic import write_json
from ftbias_jax.io.log import Log
from ftbias_jax.io.outputs import check_outputs, check_writable
from ftbias_jax.setup import Setup, load_setup
from ftbias_jax.types import Array

if TYPE_CHECKING:
    from ftbias_jax.model.effects.types import Model, Values
    from ftbias_jax.model.simulate import Simulation
    from ftbias_jax.model.trajectories import Trajectory

GENERATED = ("sines", "moves")
"""Motions that are not read from a log."""
FRANKA_CENTER = (0.0, -0.6, 0.0, -2.0, 0.0, 1.8, 0.8)  # rad, a pose with the tool in front of the arm
FRANKA_EXCURSION = (0.8, 0.5, 0.8, 0.5, 1.2, 1.0, 1.5)  # rad, within the joint limits around it
EXCURSION = (0.8, 0.1)  # rad, m: of the joints of any other arm, around zero


def run(arguments: argparse.Namespace) -> int:
    """Simulate one log; returns 3 if samples of the log to replay were lost, else 0."""
    check_writable(arguments.output, ".npz")
    truth_path = arguments.truth or f"{arguments.output.removesuffix('.npz')}_truth.npz"
    check_writable(truth_path, ".json" if truth_path.endswith(".json") else ".npz", "--truth")
    setup = load_setup(arguments.setup)
    replayed = () if arguments.motion in GENERATED else (arguments.motion,)
    check_outputs({"--output": arguments.output, "--truth": truth_path}, (*replayed, *setup.files))
    if setup.pose is not None:
        raise UsageError("needs the joints of an arm", file=arguments.setup, field="sensor_pose", remedy="use filter")

    recorded = {path: read_log(path, setup) for path in replayed}

    import jax

    from ftbias_jax.runtime.jax_config import prepare_jax

    prepare_jax()
    from ftbias_jax.io.write import npz
    from ftbias_jax.model.effects.types import Model
    from ftbias_jax.model.params import params_from_setup
    from ftbias_jax.model.simulate import simulate, temperature_course

    params = params_from_setup(setup)
    effects = parse_effects(arguments.effect, setup, Model(params.arm, params.gravity, params.theta))
    motion_key, log_key = jax.random.split(jax.random.key(arguments.seed))
    trajectory = make_motion(arguments, setup, motion_key, *recorded.values())
    measured = "temperature_drift" in effects
    temperature = temperature_course(trajectory.t) if measured else None
    simulated = simulate(log_key, params, trajectory, effects, temperature)

    log = {"t": simulated.t, "q": simulated.q, "dq": simulated.dq, "wrench": _reported(setup, simulated.wrench)}
    npz.save_npz(arguments.output, log | ({"temperature": simulated.temperature} if measured else {}))
    if truth_path.endswith(".json"):
        write_json(truth_path, _truth_summary(simulated, effects, arguments.seed))
    else:
        npz.save_npz(truth_path, _truth_arrays(simulated, trajectory, effects))
    names = ", ".join(effects) or "none"
    print(f"{len(simulated.t)} samples, {float(simulated.t[-1]):.1f} s, effects: {names}")
    print(f"wrote {arguments.output} and {truth_path}")
    return tell_repairs((path, log.repairs) for path, log in recorded.items())


def parse_effects(texts: Sequence[str], setup: Setup, model: Model) -> Values:
    """Effects of the setup, and of the command line on top: NAME or NAME:key=value,key=1/2/3.

    Raises:
        SetupError, UsageError: an unknown name, or a value that is out of bounds, not a number or missing.
    """
    from ftbias_jax.model.effects.catalogue import CATALOGUE, check_values, complete, typical_values, values_from_setup

    raw = dict(_split_effect(text) for text in texts)
    stated = {name: values for name, values in raw.items() if values or name not in CATALOGUE}
    typical = {name: typical_values(CATALOGUE[name], model) for name in raw if name not in stated}
    checked = check_values(stated, partial(UsageError, file="--effect"))
    values = values_from_setup(setup.effects, setup.path) | typical | checked
    return {name: complete(CATALOGUE[name], values[name], model) for name in CATALOGUE if name in values}


def make_motion(arguments: argparse.Namespace, setup: Setup, key: Array, recorded: Log | None = None) -> Trajectory:
    """The motion that the command line asks for: sines, moves, or the joints of a recorded log."""
    import jax.numpy as jnp

    from ftbias_jax.model import trajectories

    if recorded is not None:
        return trajectories.replay(recorded)
    center, excursion = working_range(setup)
    t = jnp.arange(max(round(arguments.duration * arguments.rate), 2)) / arguments.rate
    generate = trajectories.excitation_sines if arguments.motion == "sines" else trajectories.minimum_jerk_moves
    return generate(key, t, jnp.asarray(center), jnp.asarray(excursion))


def working_range(setup: Setup) -> tuple[Array, Array]:
    """Center and excursion (n,) rad of a sensible motion of the robot."""
    if setup.robot.model in ("panda", "fr3"):
        return np.array(FRANKA_CENTER), np.array(FRANKA_EXCURSION)
    revolute = np.abs(setup.robot.screws[:, 3:]).sum(1) > 0
    return np.zeros(len(revolute)), np.where(revolute, *EXCURSION)


def _split_effect(text: str) -> tuple[str, dict[str, Any]]:
    name, _, assignments = text.partition(":")
    values: dict[str, Any] = {}
    for assignment in filter(None, assignments.split(",")):
        key, _, numbers = assignment.partition("=")
        try:
            values[key] = [float(number) for number in numbers.split("/")]
        except ValueError as error:
            message = f"cannot read {assignment!r}"
            remedy = "write key=value or key=1/2/3"
            raise UsageError(message, file="--effect", field=name, remedy=remedy) from error
    return name, values


def _reported(setup: Setup, wrench: Array) -> Array:
    """The wrench in the sign that the setup says the sensor reports."""
    return wrench if setup.sensor.reports == "wrench_on_tool" else -wrench


def _truth_arrays(simulated: Simulation, trajectory: Trajectory, effects: Values) -> dict[str, Array]:
    """Everything that is true, at every stamp; effect parameters as ``effects.NAME.PARAMETER``."""
    series = {name: getattr(simulated, name) for name in ("t", "bias", "drift", "wrench_clean", "wrench_tool")}
    motion = {name: getattr(trajectory, name) for name in ("q", "dq", "ddq")}
    return series | motion | {f"effects.{e}.{p}": x for e, values in effects.items() for p, x in values.items()}


def _truth_summary(simulated: Simulation, effects: Values, seed: int) -> Mapping[str, Any]:
    """What is true, in short: the effects, and the bias once a second."""
    t = np.asarray(simulated.t)
    seconds = np.searchsorted(t, np.arange(np.floor(t[-1]) + 1))
    return {
        "seed": seed,
        "effects": {e: {p: np.asarray(x).tolist() for p, x in values.items()} for e, values in effects.items()},
        "bias_1hz": np.asarray(simulated.bias)[seconds].tolist(),
    }
