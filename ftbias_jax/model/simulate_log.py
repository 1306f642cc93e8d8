"""The verb ``simulate``: a log as a setup's robot would record it, and what is true about it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.errors import UsageError
from ftbias_jax.io.atomic import write_json
from ftbias_jax.io.log import Log
from ftbias_jax.io.write.npz import save_npz
from ftbias_jax.model import trajectories
from ftbias_jax.model.effects.catalogue import complete, values_of
from ftbias_jax.model.effects.terms.parse import NAME as TERM
from ftbias_jax.model.effects.types import Effect, Model, Values
from ftbias_jax.model.own_effects import catalogue_of_setup
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.model.simulate import simulate as simulate_with_params
from ftbias_jax.model.simulate import temperature_course
from ftbias_jax.model.simulated_effects import all_values, plain
from ftbias_jax.model.trajectories import Trajectory
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup.sensor_pose import require_arm
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

FRANKA_CENTER = (0.0, -0.6, 0.0, -2.0, 0.0, 1.8, 0.8)  # rad, a pose with the tool in front of the arm
FRANKA_EXCURSION = (0.8, 0.5, 0.8, 0.5, 1.2, 1.0, 1.5)  # rad, within the joint limits around it
MOST_SAMPLES = 100_000_000
"""Of one simulated log: a day at 1 kHz."""
EXCURSION = (0.8, 0.1)  # rad, m: of the joints of any other arm, around zero


class Truth(NamedTuple):
    """What is true at every stamp of a simulated log; numpy arrays, sensor frame, wrench on the tool."""

    t: Array
    """(T,) s."""
    bias: Array
    """(T, 6) N, Nm: unbiased = measured + bias; the bias process and the effects of the bias stage."""
    drift: Array
    """(T, 6) N/s, Nm/s, of the bias process."""
    wrench_clean: Array
    """(T, 6) N, Nm, what the sensor would read without bias process and noise."""
    wrench_tool: Array
    """(T, 6) N, Nm, of the tool that the setup states: no effect, no bias, no noise."""
    q: Array
    """(T, n) rad, joint positions without noise."""
    dq: Array
    """(T, n) rad/s."""
    ddq: Array
    """(T, n) rad/s^2."""
    effects: Values
    """Effect -> parameter -> value."""

    def arrays(self) -> dict[str, Array]:
        """Named arrays as they stand in a file; effect parameters as ``effects.NAME.PARAMETER``."""
        series = {name: value for name, value in self._asdict().items() if name != "effects"}
        return series | {f"effects.{e}.{p}": x for e, values in plain(self.effects).items() for p, x in values.items()}


@dataclass(frozen=True, eq=False)
class SimulationResult:
    """A simulated log and the truth about it."""

    log: Log
    """As ``read_log`` would give it: the wrench on the tool."""
    truth: Truth
    setup: Setup
    """What the log's owner believes."""
    seed: int

    def save(self, path: str | os.PathLike[str], truth: str | os.PathLike[str] | None = None) -> None:
        """Write the log in the sign that the setup's sensor reports, and the truth if it gets a name.

        Args:
            path: of the log, .npz.
            truth: of the truth: .npz with every stamp, or .json with the effects and the bias once a second.

        Raises:
            UsageError: another suffix, or one name for both. OutputError: a file cannot be written.
        """
        _check_paths(os.fspath(path), None if truth is None else os.fspath(truth))
        wrench = self.log.wrench if self.setup.sensor.reports == "wrench_on_tool" else -self.log.wrench
        log = {"t": self.log.t, "q": self.log.q, "dq": self.log.dq, "wrench": wrench}
        measured = np.isfinite(self.log.temperature).any()
        save_npz(path, log | ({"temperature": self.log.temperature} if measured else {}))
        if truth is None:
            return
        if os.fspath(truth).endswith(".json"):
            write_json(truth, self._summary())
        else:
            save_npz(truth, self.truth.arrays())

    def __str__(self) -> str:
        names = ", ".join(self.truth.effects) or "none"
        return f"{len(self.log.t)} samples, {float(self.log.t[-1]):.1f} s, effects: {names}"

    def _summary(self) -> dict[str, Any]:
        """What is true, in short: the effects, and the bias once a second."""
        t = self.truth.t
        seconds = np.searchsorted(t, np.arange(np.floor(t[-1]) + 1))
        effects = plain(self.truth.effects)
        return {
            "seed": self.seed,
            "effects": {e: {p: np.asarray(x).tolist() for p, x in values.items()} for e, values in effects.items()},
            "bias_1hz": self.truth.bias[seconds].tolist(),
        }


@in_float64
def simulate(
    setup: Setup,
    effects: Mapping[str, Mapping[str, Any]] | None = None,
    *,
    duration: float = 60.0,
    rate: float = 500.0,
    motion: str | Log = "sines",
    seed: int = 0,
    own: Sequence[Effect] = (),
) -> SimulationResult:
    """Simulate a log of the setup's robot, sensor and tool, with effects of the catalogue; the noise is the setup's.

    Computes in float64 whatever JAX's setting is, and keeps compiled programs in the user's cache folder
    (``FTBIAS_CACHE=off`` does not).

    Args:
        setup: robot, sensor, tool, noise and effects.
        effects: effect -> parameter -> value, in the catalogue's units, on top of the setup's; {} = typical values.
        duration: s.
        rate: samples a second.
        motion: "sines", "moves", or a log whose joints are replayed, with its own stamps.
        seed: of the random numbers; the same gives the same motion, bias and noise with any effects.
        own: effects of your own beside those of the catalogue.

    Raises:
        SetupError: an effect of the setup is unknown or impossible. UsageError: one of ``effects`` is, or another
            argument.
    """
    require_arm(setup)
    setup = setup.with_effects(own)
    _check_motion(duration, rate, motion)
    params = params_from_setup(setup)
    model = Model(params.arm, params.gravity, params.theta)
    catalogue = catalogue_of_setup(setup)
    stated = all_values(setup, effects or {}, model)
    completed = {
        name: complete(catalogue[name], value, model) if name in catalogue else value for name, value in stated.items()
    }
    values = values_of(completed, catalogue)
    motion_key, log_key = jax.random.split(jax.random.key(seed))
    trajectory = _trajectory(setup, motion, duration, rate, motion_key)
    drives = {term.drive for term in values.get(TERM, {}).values()}
    warming = "temperature" in drives or any("temperature" in catalogue[x].needs for x in values if x in catalogue)
    temperature = temperature_course(trajectory.t) if warming else None
    made = simulate_with_params(log_key, params, trajectory, values, temperature)
    made, trajectory, values = jax.tree.map(np.asarray, (made, trajectory, values))
    recorded = np.full(len(made.t), np.nan) if temperature is None else made.temperature
    truth = Truth(
        t=made.t,
        bias=made.bias,
        drift=made.drift,
        wrench_clean=made.wrench_clean,
        wrench_tool=made.wrench_tool,
        q=trajectory.q,
        dq=trajectory.dq,
        ddq=trajectory.ddq,
        effects=values,
    )
    return SimulationResult(Log(made.t, made.q, made.dq, made.wrench, recorded), truth, setup, seed)


def working_range(setup: Setup) -> tuple[Array, Array]:
    """Center and excursion (n,) rad of a sensible motion of the robot."""
    if setup.robot.model.split("_")[0] in ("panda", "fr3"):
        return np.array(FRANKA_CENTER), np.array(FRANKA_EXCURSION)
    revolute = np.abs(setup.robot.screws[:, 3:]).sum(1) > 0
    excursion = np.where(revolute, *EXCURSION)
    if setup.robot.position_limits is None:
        return np.zeros(len(revolute)), excursion
    lowest, highest = setup.robot.position_limits.T
    excursion = np.minimum(excursion, (highest - lowest) / 2)
    return np.clip(0.0, lowest + excursion, highest - excursion), excursion


def _trajectory(setup: Setup, motion: str | Log, duration: float, rate: float, key: Array) -> Trajectory:
    """The motion that is asked for."""
    if isinstance(motion, Log):
        return trajectories.replay(motion)
    center, excursion = working_range(setup)
    t = jnp.arange(max(round(duration * rate), 2)) / rate
    generate = trajectories.excitation_sines if motion == "sines" else trajectories.minimum_jerk_moves
    return generate(key, t, jnp.asarray(center), jnp.asarray(excursion))


def _check_motion(duration: float, rate: float, motion: str | Log) -> None:
    if not isinstance(motion, Log) and motion not in ("sines", "moves"):
        raise UsageError(f"got {motion!r}", field="motion", remedy="give 'sines', 'moves', or a log that read_log read")
    for name, value in {"duration": duration, "rate": rate}.items():
        if not 0 < value < float("inf"):
            raise UsageError(f"must be a positive number, not {value!r}", field=name)
    if duration * rate > MOST_SAMPLES:
        remedy = f"ask for at most {MOST_SAMPLES} samples: seconds times rate"
        raise UsageError(f"{duration * rate:.3g} samples do not fit the memory", field="duration", remedy=remedy)


def _check_paths(path: str, truth: str | None) -> None:
    if not path.endswith(".npz"):
        raise UsageError(f"cannot write {path!r}", field="path", remedy="end the name in .npz")
    if truth is None:
        return
    if not truth.endswith((".npz", ".json")):
        raise UsageError(f"cannot write {truth!r}", field="truth", remedy="end the name in .npz or .json")
    if os.path.realpath(path) == os.path.realpath(truth):
        raise UsageError("log and truth have the same name", field="truth", remedy="give them different ones")
