"""A recorded log, and the repairs and omissions that were made in it."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array


class Repair(NamedTuple):
    """One kind of repair, or a fact that the owner of the log should know."""

    what: str
    """One line that names the stream or the axis and the count."""
    lost: bool = False
    """Whether samples of the log were left out."""


Repairs = tuple[Repair, ...]


class Column(NamedTuple):
    """A further quantity that the setup names, with its own stamps."""

    t: Float[Array, " K"]
    """(K,) s, increasing, relative to the first sample of the log."""
    values: Float[Array, " K"]
    """(K,) in the unit of the column, all of them measured."""

    def at(self, t: Float[Array, " T"]) -> Float[Array, " T"]:
        """(T,) values at other stamps: linear interpolation, and the first or last value outside."""
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
    """s, recorded stamp of the first sample: t + start are the stamps as recorded, if these are steady."""
    repairs: Repairs = ()
    """Repairs and omissions, and other facts that the owner of the log should know."""
    columns: Mapping[str, Column] = MappingProxyType({})
    """Further quantities by their names in [log.columns] of the setup; a part of a log has those of the whole."""
    file: str = ""
    """File or URL that the log was read from; "" = from memory."""
    frame: str = ""
    """Frame of the sensor as named in a ROS recording; "" = unknown."""
    rezeroed_at: tuple[float, ...] = ()
    """s, relative to the first sample: times at which the sensor was zeroed, as the setup states; some may lie outside
    this log and belong to others."""

    acceleration_std: Float[Array, " 3"] = np.zeros(3)
    """(3,) m/s^2, sensor axes: standard deviation of the remaining error, nearly constant, of the accelerometer that
    gives the motion."""

    def is_rezeroed(self, t: Float[Array, " T"], before: float | None = None) -> Float[Array, " T"]:
        """(T,) whether the sensor was zeroed between each stamp, s, and the previous one.

        Args:
            t: (T,) s, increasing, relative to the first sample.
            before: the stamp before the first of these, s; None = there is none, and earlier zeroing is ignored.
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
        """Make a log from arrays in memory, checked and cleaned as by ``read_log``; see ``io.log_of_arrays``."""
        # ``io.__init__`` replaces this by ``log_of_arrays``, because checking and cleaning depend on this module.
        raise NotImplementedError
