"""Which column of a CSV log is which quantity: as the setup names them, or by the usual names in the header."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ftbias_jax.errors import LogError
from ftbias_jax.setup.fields import nearest
from ftbias_jax.setup.recorded import PoseSetup
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

Names = tuple[str, ...]


class Columns(NamedTuple):
    """Column names of every quantity; () = the log does not have it."""

    time: Names
    """1, or 0 if the setup states the rate."""
    position: Names
    """n, in the order of the setup's joints."""
    velocity: Names
    """n or 0."""
    wrench: Names
    """6."""
    temperature: Names
    """1 or 0."""


def named_arrays(columns: Columns, values: Sequence[Array]) -> dict[str, Array]:
    """What was found, by the names of the native format.

    Args:
        columns: of ``choose_columns``.
        values: (T, k) of each quantity, with as many columns as it has names.
    """
    names = ("t", "q", "dq", "wrench", "temperature")
    found = {name: x for name, x in zip(names, values, strict=True) if x.shape[1]}
    return {name: x[:, 0] if name in ("t", "temperature") else x for name, x in found.items()}


def choose_columns(header: Sequence[str], setup: Setup, file: str = "", static: bool = False) -> Columns:
    """Find the columns of a log.

    Args:
        header: the names of all columns.
        setup: names of the joints, and [log.columns], which comes first.
        file: the name in messages.
        static: of poses at rest: time is optional, rates are not looked for.

    Raises:
        LogError: a quantity that every log needs has no columns, or a name is not there or not unique.
    """
    usual = usual_names(setup.robot.joint_names)
    if setup.pose is not None:
        usual |= pose_names(setup.pose)
    optional = ("velocity", "temperature", "time") if static else ("velocity", "temperature")
    unwanted = {"velocity"} if static else {"time"} if setup.log.rate is not None else set()
    chosen = [
        () if quantity in unwanted else _choose(quantity, usual[quantity], header, setup, optional, file)
        for quantity in Columns._fields
    ]
    for name in sum(chosen, ()):
        if header.count(name) > 1:
            raise LogError("two columns have this name", file=file, field=name, remedy="rename one of them")
    return Columns(*chosen)


def choose_time(header: Sequence[str], setup: Setup, file: str = "") -> Names:
    """The column of the stamps; () if the setup states a rate instead.

    Raises:
        LogError: it is not there.
    """
    if setup.log.rate is not None:
        return ()
    return _choose("time", usual_names(())["time"], header, setup, (), file)


def choose_some(header: Sequence[str], quantities: Sequence[str], setup: Setup, file: str) -> Columns:
    """The columns of a file that has only some quantities, of which the first must be there.

    Raises:
        LogError: the first quantity, or the time, has no columns.
    """
    usual = usual_names(setup.robot.joint_names) | (pose_names(setup.pose) if setup.pose else {})
    needed = ["time", *quantities] if setup.log.rate is None else quantities
    optional = ("velocity", "temperature")
    found = {quantity: _choose(quantity, usual[quantity], header, setup, optional, file) for quantity in needed}
    if not found[quantities[0]]:
        raise _not_found(quantities[0], usual[quantities[0]], header, file)
    return Columns(*(found.get(quantity, ()) for quantity in Columns._fields))


def check_names(names: Sequence[str], header: Sequence[str], file: str = "") -> None:
    """Refuse further columns that are not there, or not unique.

    Args:
        names: in the file, as [log.columns] of the setup states.
        header: the names of all columns.
        file: the name in messages.

    Raises:
        LogError: it names the column.
    """
    for name in names:
        if name not in header:
            message = "log.columns of the setup names this column, but it is not there"
            raise LogError(message, file=file, field=name, remedy=nearest(name, header))
        if header.count(name) > 1:
            raise LogError("two columns have this name", file=file, field=name, remedy="rename one of them")


def usual_names(joint_names: Sequence[str]) -> dict[str, list[Names]]:
    """Sets of column names that need no declaration, by quantity, the first that is complete wins."""
    n = len(joint_names)

    def joints(letter: str, quantity: str) -> list[Names]:
        counted = [tuple(f"{letter}{i}" for i in range(first, first + n)) for first in (0, 1)]
        return [*counted, tuple(f"{quantity}_{name}" for name in joint_names)]

    return {
        "time": [("t",), ("time",)],
        "position": [*joints("q", "position"), tuple(joint_names)],
        "velocity": joints("dq", "velocity"),
        "wrench": [("fx", "fy", "fz", "tx", "ty", "tz"), ("fx", "fy", "fz", "mx", "my", "mz")],
        "temperature": [("temperature",)],
    }


def pose_names(pose: PoseSetup) -> dict[str, list[Names]]:
    """The same for a recorded pose: positions are orientation and position, velocities what an IMU says."""
    orders = {
        "quaternion_xyzw": ("qx", "qy", "qz", "qw"),
        "quaternion_wxyz": ("qw", "qx", "qy", "qz"),
        "matrix": tuple(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)),
        "axis_angle": ("rx", "ry", "rz"),
    }
    position = ("x", "y", "z") if pose.linear == "position" else ()
    force = ("ax", "ay", "az") if pose.linear == "specific_force" else ()
    gyroscope = [("wx", "wy", "wz", *force)] if pose.gyroscope else []
    return {
        "position": [(*orders[pose.orientation], *position)],
        "velocity": [*gyroscope, *([force] if force else [])],  # some IMUs have no gyroscope
    }


def _choose(
    quantity: str, usual: Sequence[Names], header: Sequence[str], setup: Setup, optional: Names, file: str
) -> Names:
    declared = setup.log.columns.get(quantity, ())
    names = (declared,) if isinstance(declared, str) else declared
    for name in names:
        if name not in header:
            message = f"log.columns.{quantity} of the setup names this column, but it is not there"
            raise LogError(message, file=file, field=name, remedy=nearest(name, header))
    if names:
        return names
    present = next((candidate for candidate in usual if set(candidate) <= set(header)), ())
    if present and not _one_more(present, header):
        return present
    some = any(name in header for candidate in usual for name in candidate)
    if quantity in optional and not some:  # some, but not all, is a mistake to report
        return ()
    raise _not_found(quantity, usual, header, file)


def _one_more(names: Names, header: Sequence[str]) -> bool:
    """Whether counted columns go on, q0..q7 for 7 joints: then the log is of another robot, or has a gripper."""
    letter, last = names[-1].rstrip("0123456789"), names[-1]
    return last != letter and letter in ("q", "dq") and f"{letter}{int(last[len(letter) :]) + 1}" in header


def _not_found(quantity: str, usual: Sequence[Names], header: Sequence[str], file: str) -> LogError:
    wanted = " or ".join(" ".join(names) for names in usual)
    found = ", ".join(header[:40]) + (", ..." if len(header) > 40 else "")
    example = '"..."' if quantity == "time" else '["...", ...]'
    return LogError(
        f"no columns for the {quantity}: looked for {wanted}; the header has {found}",
        file=file,
        field=quantity,
        remedy=f"name them in the setup: [log.columns] {quantity} = {example}",
    )
