"""The verb ``simulate``: a log as the robot of a setup would record it, and its ground truth."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.errors import UsageError, is_integer, is_number
from ftbias_jax.io.atomic import write_json
from ftbias_jax.io.log import Column, Log
from ftbias_jax.io.write.npz import save_npz, texts_of_log
from ftbias_jax.io.write.provenance import Provenance, provenance, source_of
from ftbias_jax.model import pose_log, trajectories
from ftbias_jax.model.effects.catalogue import (
    CATALOGUE,
    Catalogue,
    check_values,
    complete,
    typical_values,
    values_from_setup,
    values_of,
)
from ftbias_jax.model.effects.terms.parse import TERM, flat_numbers
from ftbias_jax.model.effects.types import Effect, Model, Values
from ftbias_jax.model.own_effects import catalogue_of_setup, check_observable
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.model.pose_log import tumbling, with_positions
from ftbias_jax.model.simulate import simulate as simulate_with_params
from ftbias_jax.model.simulate import temperature_course
from ftbias_jax.model.trajectories import Trajectory
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup import GivenSetup, as_setup
from ftbias_jax.setup.keys.table import further_columns
from ftbias_jax.setup.types import REPORTS, Setup
from ftbias_jax.types import Array


class Truth(NamedTuple):
    """Ground truth at every stamp of a simulated log; numpy arrays, sensor frame, wrench on the tool."""

    t: Array
    """(T,) s."""
    bias: Array
    """(T, 6) N, Nm, with unbiased = measured + bias: the bias process plus the effects of the bias stage."""
    drift: Array
    """(T, 6) N/s, Nm/s: drift of the bias process."""
    wrench_clean: Array
    """(T, 6) N, Nm: reading of the sensor without bias process and noise."""
    wrench_tool: Array
    """(T, 6) N, Nm: wrench of the tool that the setup states, without effects, bias or noise."""
    q: Array
    """(T, n) rad, joint positions without noise."""
    dq: Array
    """(T, n) rad/s."""
    ddq: Array
    """(T, n) rad/s^2."""
    effects: Values
    """Effect -> parameter -> value."""

    def arrays(self) -> dict[str, Array]:
        """Arrays by name, as written to a file; effect parameters are ``effects.NAME.PARAMETER``."""
        series = {name: value for name, value in self._asdict().items() if name != "effects"}
        return series | {f"effects.{e}.{p}": x for e, values in plain(self.effects).items() for p, x in values.items()}


@dataclass(frozen=True, eq=False)
class SimulationResult:
    """A simulated log and its ground truth."""

    log: Log
    """The log as ``read_log`` would return it, with the wrench on the tool."""
    truth: Truth
    setup: Setup
    """The setup as given to ``simulate``: the nominal model, without the effects that were added."""
    seed: int
    recorded: Mapping[str, Array]
    """Recorded arrays of the motion, under the names of the native format: q and dq, or orientation and so on."""

    def save(self, path: str | os.PathLike[str], truth: str | os.PathLike[str] | None = None) -> None:
        """Write the log in the sign that the setup's sensor reports, and the ground truth if ``truth`` is given.

        Args:
            path: file of the log, .npz.
            truth: file of the ground truth: .npz with every stamp, or .json with the effects and the bias at 1 Hz.

        Raises:
            UsageError: another suffix, or the same name for both. OutputError: a file cannot be written.
        """
        _check_paths(os.fspath(path), None if truth is None else os.fspath(truth))
        wrench = self.log.wrench if self.setup.sensor.reports == "wrench_on_tool" else -self.log.wrench
        log = {"t": self.log.t, **self.recorded, "wrench": wrench}
        measured = np.isfinite(self.log.temperature).any()
        extra = further_columns(self.setup.log.columns)
        columns = {extra.get(name, name): column.at(self.log.t) for name, column in self.log.columns.items()}
        log |= columns | ({"temperature": self.log.temperature} if measured else {})
        save_npz(path, log | texts_of_log(log, self.setup.sensor.reports, self.provenance))
        if truth is None:
            return
        if os.fspath(truth).endswith(".json"):
            write_json(truth, self._summary() | {"provenance": self.provenance})
        else:
            truths = self.truth.arrays()
            save_npz(truth, truths | texts_of_log(truths, REPORTS[0], self.provenance))

    @property
    def provenance(self) -> Provenance:
        """Provenance of the log as written to files; the effects are in the ground truth alone."""
        return provenance(self.setup, [source_of(self.log)], {"simulated": True, "seed": self.seed})

    def __str__(self) -> str:
        names = ", ".join(self.truth.effects) or "none"
        return f"{len(self.log.t)} samples, {float(self.log.t[-1]):.1f} s, effects: {names}"

    def _summary(self) -> dict[str, Any]:
        """Summary of the ground truth: the effects, and the bias once a second."""
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
    setup: GivenSetup,
    effects: Mapping[str, Mapping[str, Any]] | None = None,
    *,
    duration: float = 60.0,
    rate: float = 500.0,
    motion: str | Log = "sines",
    seed: int = 0,
    own: Sequence[Effect] = (),
    columns: Mapping[str, Array] | None = None,
) -> SimulationResult:
    """Simulate a log of the setup's robot, sensor and tool, with effects of the catalogue; the noise is the setup's.

    Computes in float64 whatever JAX's setting is, and keeps compiled programs in the user's cache folder
    (not with ``FTBIAS_CACHE=off``).

    Args:
        setup: robot, sensor, tool, noise and effects, or the path of the setup.
        effects: effect -> parameter -> value, in the catalogue's units, added to the setup's; {} = typical values.
        duration: s.
        rate: samples per second.
        motion: "sines", "moves", or a log whose joints or poses are replayed, with its own stamps. If the setup has
            sensor_pose, the sensor rotates about three axes and translates along them.
        seed: seed of the random numbers; the same seed gives the same motion, bias and noise with any effects.
        own: user-defined effects beside those of the catalogue.
        columns: name -> (T,) further quantities at the stamps that effects may depend on; None = those of the replayed
            log.

    Raises:
        SetupError: an effect of the setup is unknown or impossible. UsageError: one of ``effects`` is unknown or
            impossible, or makes a reading that is not finite, or another argument is invalid.
    """
    setup = as_setup(setup, own)
    check_motion(duration, rate, motion)
    if not is_integer(seed):
        raise UsageError(f"must be an integer, not {seed!r}", field="seed")
    params = params_from_setup(setup)
    # Unrecorded accelerations are noise for the filter, but a simulated sensor rotates in place.
    params = params._replace(bias=params.bias._replace(wrench_variance=jnp.asarray(setup.sensor.noise_std) ** 2))
    model = Model(params.arm, params.gravity, params.theta)
    catalogue = catalogue_of_setup(setup)
    stated = all_values(setup, effects or {}, model)
    completed = {name: complete(catalogue[name], value, model) for name, value in stated.items() if name in catalogue}
    values = values_of({**stated, **completed}, catalogue)
    motion_key, log_key = jax.random.split(jax.random.key(seed))
    trajectory = trajectory_of(setup, motion, duration, rate, motion_key)
    drives = {term.drive for term in values.get(TERM, {}).values()}
    warming = "temperature" in drives or any("temperature" in catalogue[x].needs for x in values if x in catalogue)
    temperature = temperature_course(trajectory.t) if warming else None
    seen = columns_of(columns, motion, np.asarray(trajectory.t))
    check_needs(catalogue, values, seen)
    made = simulate_with_params(log_key, params, trajectory, values, temperature, seen)
    made, trajectory, values = jax.tree.map(np.asarray, (made, trajectory, values))
    _check_reading(made.wrench_clean, (len(made.t), 6), [name for name in values if name not in {*CATALOGUE, TERM}])
    felt = np.full(len(made.t), np.nan) if temperature is None else made.temperature
    _, q, dq, ddq = trajectory
    truth = Truth(made.t, made.bias, made.drift, made.wrench_clean, made.wrench_tool, q, dq, ddq, values)
    kept = {name: Column(made.t, values) for name, values in seen.items()}
    recorded = {"q": made.q, "dq": made.dq}
    log = Log(made.t, made.q, made.dq, made.wrench, felt, columns=kept)
    if setup.pose is not None:
        recorded = pose_log.recorded_arrays(setup, made, trajectory, params.arm, log_key)
        q, dq = pose_log.entries_of(setup, made.t, recorded)
        log = log._replace(q=q, dq=dq)
    return SimulationResult(log, truth, setup, seed, recorded)


def _check_paths(path: str, truth: str | None) -> None:
    if not path.endswith(".npz"):
        raise UsageError(f"cannot write {path!r}", field="path", remedy="end the name in .npz")
    if truth is not None and not truth.endswith((".npz", ".json")):
        raise UsageError(f"cannot write {truth!r}", field="truth", remedy="end the name in .npz or .json")
    if truth is not None and os.path.realpath(path) == os.path.realpath(truth):
        raise UsageError("log and truth have the same name", field="truth", remedy="give them different ones")


MOST_SAMPLES = 100_000_000
"""Maximum number of samples of one simulated log: a day at 1 kHz."""


def trajectory_of(setup: Setup, motion: str | Log, duration: float, rate: float, key: Array) -> Trajectory:
    """Trajectory of the requested motion."""
    if isinstance(motion, Log):
        return trajectories.replay(motion if setup.pose is None else with_positions(motion))
    t = jnp.arange(max(round(duration * rate), 2)) / rate
    generate = trajectories.excitation_sines if motion == "sines" else trajectories.minimum_jerk_moves
    if setup.pose is not None:
        return tumbling(generate, key, t, len(setup.robot.joint_names))
    center, excursion = trajectories.working_range(setup)
    return generate(key, t, jnp.asarray(center), jnp.asarray(excursion))


def _check_reading(wrench: Array, shape: tuple[int, int], own: Sequence[str]) -> None:
    """Raise an error for a reading that no sensor gives, which only user-defined effects can cause."""
    if not own or (wrench.shape == shape and np.isrealobj(wrench) and np.isfinite(wrench).all()):
        return
    message = f"with {', '.join(own)} the reading is not an array {shape} of finite real numbers"
    raise UsageError(message, field="own", remedy="correct the code: ftbias effects check FILE.py")


def check_motion(duration: float, rate: float, motion: str | Log) -> None:
    """Raise an error for an unknown motion, a duration or rate that is not positive, and too many samples."""
    if not isinstance(motion, Log) and motion not in ("sines", "moves"):
        raise UsageError(f"got {motion!r}", field="motion", remedy="give 'sines', 'moves', or a log that read_log read")
    for name, value in {"duration": duration, "rate": rate}.items():
        if not is_number(value):
            raise UsageError(f"must be a positive number, not {value!r}", field=name)
    if duration * rate > MOST_SAMPLES:
        remedy = f"ask for at most {MOST_SAMPLES} samples: seconds times rate"
        raise UsageError(f"{duration * rate:.3g} samples do not fit into memory", field="duration", remedy=remedy)


def columns_of(columns: Mapping[str, Array] | None, motion: str | Log, t: Array) -> dict[str, Array]:
    """Further quantities at the stamps: name -> (T,)."""
    if columns is None:
        return {name: column.at(t) for name, column in motion.columns.items()} if isinstance(motion, Log) else {}
    made = {name: np.asarray(values, float) for name, values in columns.items()}
    for name, values in made.items():
        if values.shape != t.shape or not np.isfinite(values).all():
            message = f"has shape {values.shape}, or numbers that are not finite, for {len(t)} stamps"
            raise UsageError(message, field=f"columns: {name}", remedy="give one finite number per sample")
    return made


def check_needs(catalogue: Catalogue, values: Values, columns: Mapping[str, Array]) -> None:
    """Raise an error for effects that depend on a column which is not given."""
    for name in (name for name in values if name in catalogue):
        for need in catalogue[name].needs:
            if need != "temperature" and need not in columns:
                remedy = "give it by columns={...}, or replay a log that has it (motion)"
                raise UsageError(f"needs the column {need!r}", field=f"effects: {name}", remedy=remedy)


def all_values(setup: Setup, effects: Mapping[str, Mapping[str, Any]], model: Model) -> Values:
    """Values of the setup's effects, overridden by ``effects``, in the catalogue's order; {} = typical values."""
    catalogue = catalogue_of_setup(setup)
    checked = check_effects(effects, catalogue)
    check_observable(effects, setup, partial(UsageError, file="effects"))
    typical = {name: typical_values(catalogue[name], model) for name in effects if name not in checked}
    values = values_from_setup(setup.effects, setup.path, catalogue) | typical | checked
    return {name: values[name] for name in (*catalogue, TERM) if name in values}


def plain(effects: Values) -> Values:
    """Effect -> parameter -> numbers; the numbers of terms are named after the number of their section."""
    return {name: flat_numbers(values) if name == TERM else values for name, values in effects.items()}


def check_effects(effects: Mapping[str, Mapping[str, Any]], catalogue: Catalogue, file: str = "effects") -> Values:
    """Checked values of the effects that state any; unknown names, wrong shapes and exceeded bounds are refused."""
    if not hasattr(effects, "items"):
        remedy = "give a dict, such as {'cable': {}} for a cable with typical values"
        raise UsageError(f"got {type(effects).__name__}", field=file, remedy=remedy)
    stated = {name: values for name, values in effects.items() if values or name not in catalogue}
    return check_values(stated, partial(UsageError, file=file), catalogue=catalogue)
