"""A recorded log, and what was mended or left out to make it one."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array


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
    """s, the log's own stamp of the first sample: t + start are the stamps as recorded, if these are steady."""
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

    acceleration_std: Float[Array, " 3"] = np.zeros(3)
    """(3,) m/s^2, sensor axes, standard deviation: what is not known of the accelerometer whose readings make the
    motion; it is all but constant."""

    def is_rezeroed(self, t: Float[Array, " T"], before: float | None = None) -> Float[Array, " T"]:
        """(T,) whether the sensor was set to zero between each stamp, s, and the one before it.

        Args:
            t: (T,) s, increasing, relative to the first sample.
            before: the stamp before the first of these; None = there is none, and what was before does not count.
        """
        times = np.sort(self.rezeroed_at)
        first = t[:1] if before is None else [before]
        return np.diff(np.searchsorted(times, np.concatenate([first, t]), side="right")) > 0

    @staticmethod
    def from_arrays(
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
        """A log from arrays in memory, checked and cleaned as one that ``read_log`` reads: ``io.log_of_arrays``."""
        # The room's __init__ binds that function, because what checks and cleans a log is made of logs.
        raise NotImplementedError
