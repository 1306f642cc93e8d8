"""Result of a plan: the motion, the forecast of what it determines, and how much of the limits it uses."""

import os
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.io.atomic import plain, write_atomic, write_json
from ftbias_jax.io.log import Log
from ftbias_jax.io.write import writer
from ftbias_jax.io.write.provenance import Provenance, provenance, source_of
from ftbias_jax.io.write.selection import About
from ftbias_jax.planning.asked import Asked
from ftbias_jax.planning.controllers import FORMATS, check_controllers
from ftbias_jax.planning.forecast import Forecast
from ftbias_jax.planning.limits import NOT_KNOWN, QUANTITIES
from ftbias_jax.planning.page import plan_page
from ftbias_jax.planning.shape import Motion, motion_at
from ftbias_jax.setup.save import write_text
from ftbias_jax.setup.types import Setup


class Options(NamedTuple):
    """What was requested."""

    to_find: str
    duration: float
    """s."""
    rate: float
    """Hz."""
    margin: float
    """Share of every limit left unused."""
    seed: int


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion that starts and ends at rest in the same pose, and the forecast of what a log of it determines."""

    setup: Setup
    options: Options
    asked: tuple[Asked, ...]
    motion: Motion
    """The motion at the requested rate."""
    coefficients: np.ndarray
    """(n, M) coefficients of the joints' Fourier series."""
    forecast: Forecast
    used: np.ndarray
    """(4, n) largest share of its position, velocity, acceleration and jerk that each joint uses, at 1 kHz."""
    assumed: tuple[str, ...]
    """Descriptions of limits that were assumed because nothing states them."""
    logs: tuple[Log, ...] = ()
    """Existing logs that the forecast includes."""
    seconds: float = 0.0
    """s, computing time."""

    def at(self, t: np.ndarray) -> Motion:
        """The motion at any times t (T,) s since its start; before and after it the arm stands still."""
        return motion_at(np.asarray(t, float), self.options.duration, self.motion.q[0], self.coefficients)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the motion as a table with t, q0.., dq0.., ddq0.. in s, rad, rad/s, rad/s^2.

        Args:
            path: .csv, .npz or .parquet.

        Raises:
            OutputError: it cannot be written there. UsageError: another suffix.
        """
        arrays = {name: getattr(self.motion, name) for name in ("t", "q", "dq", "ddq")}
        writer(path)(path, arrays, About(origin=self.provenance))  # with all digits: jerk is their third difference

    def to_json(self, path: str | os.PathLike[str]) -> None:
        """Write the forecast and the use of the limits as JSON."""
        write_json(path, self.plain() | {"provenance": self.provenance})

    def to_html(self, path: str | os.PathLike[str]) -> None:
        """Write an HTML page with the forecast, the path and the use of the limits.

        Raises:
            OutputError: the file cannot be written there.
        """
        write_text(path, plan_page(self))

    def save_for(self, path: str | os.PathLike[str], format: str) -> None:
        """Write the motion in the format of a robot's controller.

        Args:
            path: the file.
            format: "ros", a JointTrajectory as YAML; "bag", the same as MCAP; "ur", URScript; "franka", positions for
                every millisecond as JSON.

        Raises:
            UsageError: there is no such format, or its robots have another number of joints than the arm. OutputError:
                the file cannot be written there.
        """
        check_controllers(self.setup, [format])
        content = FORMATS[format](self)
        write_atomic(path, lambda file: file.write(content if isinstance(content, bytes) else content.encode()))

    @property
    def provenance(self) -> Provenance:
        """Provenance of the plan, as written to files: setup, logs and options."""
        return provenance(self.setup, [source_of(log) for log in self.logs], self.options._asdict())

    def plain(self) -> dict[str, Any]:
        """Expected standard errors, separations, what is not determined, and shares of limits, as plain numbers."""
        forecast = self.forecast

        def named(stds: np.ndarray | None) -> Any:
            return None if stds is None else plain(dict(zip(forecast.labels, stds, strict=True)))

        return {
            "duration": self.options.duration,
            "expected_std": named(forecast.plan),
            "from_log_std": named(forecast.logs),
            "together_std": named(forecast.together),
            "separates": forecast.separates,
            "cannot": [one._asdict() for one in forecast.cannot],
            "limits": {
                "largest_share": dict(zip(QUANTITIES, self.used.max(1).tolist(), strict=True)),
                "margin": self.options.margin,
                "assumed": list(self.assumed),
                "not_known": NOT_KNOWN,
            },
            "start": self.motion.q[0].tolist(),
            "seconds": float(f"{self.seconds:.3g}"),
        }

    def __str__(self) -> str:
        forecast, columns = self.forecast, self.forecast.columns
        lines = ["".join(f"{word:>16s}" for word in ("standard error", *columns))]
        for *words, unit in zip(forecast.labels, *columns.values(), forecast.units, strict=True):
            lines.append("".join(f"{word:>16s}" for word in words) + f"  {unit}")
        lines += [
            f"separates {name} by {nats:.1f} nats (five sigma: 12.5)" for name, nats in forecast.separates.items()
        ]
        lines += [f"does not determine {one.pair}: {one.why}" for one in forecast.cannot]
        used = ", ".join(f"{name} {share:.0%}" for name, share in zip(QUANTITIES, self.used.max(1), strict=True))
        lines.append(f"at most, of the limits: {used}")
        lines += [f"assumed: {words}" for words in self.assumed]
        return "\n".join([*lines, NOT_KNOWN])
