"""A recorded log, and what was mended or left out to make it one."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

if TYPE_CHECKING:
    from jaxtyping import Float


class Repair(NamedTuple):
    """One kind of repair, or a fact the owner should know."""

    what: str
    """One line that names the stream or the axis and the count."""
    lost: bool = False
    """Whether samples of the log were left out."""


Repairs = tuple[Repair, ...]


class Column(NamedTuple):
    """A quantity that the setup names beside those of every log, with stamps of its own."""

    t: Float[Array, " K"]
    """(K,) s, increasing, relative to the first sample of the log."""
    values: Float[Array, " K"]
    """(K,) in its own unit, all of them measured."""

    def at(self, t: Float[Array, " T"]) -> Float[Array, " T"]:
        """(T,) values at other stamps: straight lines between those measured, the first and last value outside."""
        return np.interp(t, self.t, self.values)


class Log(NamedTuple):
    """One recorded log on one merged timeline; NaN = not measured at that time.

    The wrench has the sign of the report: what the sensor exerts on the tool (at rest, z up, it reads +m g in z).
    """

    t: Float[Array, " T"]
    """(T,) s, increasing, relative to the first sample."""
    q: Float[Array, "T n"]
    """(T, n) rad (m for prismatic joints), in the order of the setup's joints."""
    dq: Float[Array, "T n"]
    """(T, n) rad/s (m/s)."""
    wrench: Float[Array, "T 6"]
    """(T, 6) N and Nm: force, then torque about the sensor origin, sensor frame."""
    temperature: Float[Array, " T"]
    """(T,) deg C."""
    start: float = 0.0
    """s, the log's own stamp of the first sample: t + start are the stamps as recorded."""
    repairs: Repairs = ()
    """What was mended or left out, and what else its owner should know."""
    columns: Mapping[str, Column] = MappingProxyType({})
    """Further quantities by the names that the setup gives them in [log.columns]; those of a part are of the whole."""
    file: str = ""
    """Where it was read from; "" = from memory."""
    frame: str = ""
    """The sensor's frame, as a recording of ROS names it; "" = not known."""
    rezeroed_at: tuple[float, ...] = ()
    """s, relative to the first sample: when the sensor was set to zero, as the setup states; some may be of other logs,
    outside of this one's time."""

    def is_rezeroed(self, t: Float[Array, " T"], before: float | None = None) -> Float[Array, " T"]:
        """(T,) whether the sensor was set to zero between each stamp, s, and the one before it.

        Args:
            t: (T,) s, increasing, relative to the first sample.
            before: the stamp before the first of these; None = there is none, and what was before does not count.
        """
        times = np.sort(self.rezeroed_at)
        first = t[:1] if before is None else [before]
        return np.diff(np.searchsorted(times, np.concatenate([first, t]), side="right")) > 0

    @classmethod
    def from_arrays(
        cls,
        setup: Setup,
        t: Array | tuple[Array, Array],
        q: Array | None,
        wrench: Array,
        dq: Array | None = None,
        temperature: Array | None = None,
        *,
        orientation: Array | None = None,
        position: Array | None = None,
        angular_velocity: Array | None = None,
        specific_force: Array | None = None,
        columns: Mapping[str, Array] | None = None,
        raw: bool = False,
    ) -> Log:
        """A log from arrays in memory, checked and cleaned as one that ``read_log`` reads.

        Args:
            setup: gives the number of joints and the sensor's sign.
            t: (T,) stamps: floating point in s, or integers in ns; any origin. Or a pair of them, (J,) for the joints
                or the pose and (W,) for wrench and temperature, if the two streams have stamps of their own.
            q: (T, n) rad (m); None if the setup has a sensor_pose.
            wrench: (T, 6) N, Nm, sensor frame, as the sensor reports it. NaN = not measured, here and elsewhere.
            dq: (T, n) rad/s (m/s), or None.
            temperature: (T,) deg C, or None.
            orientation: (T, 4) or (T, 3, 3) of the sensor's mount in the base frame, as the setup's sensor_pose states.
            position: (T, 3) m, base frame, of the same.
            angular_velocity: (T, 3) rad/s of an IMU, as the setup's sensor_pose states.
            specific_force: (T, 3) m/s^2, acceleration less gravity, of the same.
            columns: name -> (T,) further quantities for effects to see, at the stamps (of the wrench).
            raw: leave samples of stuck and clipped axes and repeats in, as recorded; ``repairs`` names them.

        Raises:
            LogError: shapes disagree, the clock was set back, a value is infinite, or there is no motion or no wrench.
        """
        # Imported here, because what checks and cleans a log is made of logs.
        from ftbias_jax.io.cleaning import clean
        from ftbias_jax.io.tables.arrays import log_from_arrays
        from ftbias_jax.io.tables.extra import column_of

        times = {"t_joints": t[0], "t_wrench": t[1]} if isinstance(t, tuple) else {"t": t}
        arrays = times | {
            "q": q,
            "wrench": wrench,
            "dq": dq,
            "temperature": temperature,
            "orientation": orientation,
            "position": position,
            "angular_velocity": angular_velocity,
            "specific_force": specific_force,
        }
        log = log_from_arrays({name: values for name, values in arrays.items() if values is not None}, setup)
        stamps = t[1] if isinstance(t, tuple) else t
        extra = {name: column_of(stamps, values, log.start, field=name) for name, values in (columns or {}).items()}
        return clean(log._replace(columns=extra), clipped=not raw, stuck=not raw, held=not raw)
