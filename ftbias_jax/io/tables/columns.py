"""Assignment of a table's columns to quantities: as the setup names them, or by the usual names in the header."""

from collections.abc import Collection, Sequence
from itertools import product

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.check import EXTRA_PREFIX
from ftbias_jax.io.tables.column_names import FIXED, Names
from ftbias_jax.io.tables.headers import Match, matches, some
from ftbias_jax.setup.fields import nearest
from ftbias_jax.setup.keys.table import further_columns
from ftbias_jax.setup.recorded import PoseSetup
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

EXAMPLES = {
    "time": "t, time or timestamp",
    "temperature": "temperature",
    "position": "q0 q1 ..., joint_1 joint_2 ..., or position_NAME of every joint",
    "velocity": "dq0 dq1 ..., or velocity_NAME of every joint",
    "wrench": "fx fy fz tx ty tz, force_x ... torque_z, or ft_0 ... ft_5",
}
"""Quantity -> names that are looked for, as error messages list them."""
NAMES = {"time": "t", "position": "q", "velocity": "dq", "wrench": "wrench", "temperature": "temperature"}
"""Quantity -> the array of a log that its columns form."""
WIDE = ("q", "dq", "wrench")
"""Arrays with several numbers per sample."""
OPTIONAL = frozenset(("velocity", "temperature"))

Columns = dict[str, Names]
"""Name of an array of a log, or of a further column -> the columns that form it; () = the log does not have it."""


def split(columns: Columns, values: Array) -> dict[str, Array]:
    """Split values (T, K) of all columns, in order, into arrays by name; those with one number per sample are (T,)."""
    ends = np.cumsum([len(names) for names in columns.values()])
    parts = zip(columns, np.split(values, ends[:-1], axis=1), strict=True)
    return {name: x if name in WIDE else x[:, 0] for name, x in parts if x.shape[1]}


def choose_columns(
    header: Sequence[str], quantities: Sequence[str], setup: Setup, file: str = "", static: bool = False
) -> Columns:
    """Select the columns of the stamps, of some quantities (the first is required) and of further named columns.

    Static poses may have no stamps, and have no further columns.
    """
    needed = ["time", *quantities] if static or setup.log.rate is None else quantities
    optional = OPTIONAL | {"time"} if static else OPTIONAL
    found = {quantity: _choose(quantity, header, setup, optional, file) for quantity in needed}
    if not found[quantities[0]]:
        raise _not_found(quantities[0], header, setup, file)
    further = {} if static else named_columns(header, setup, file)
    columns = {NAMES[quantity]: names for quantity, names in found.items()} | further
    for name in sum(columns.values(), ()):
        if header.count(name) > 1:
            raise LogError("two columns have this name", file=file, field=name, remedy="rename one of them")
    return columns


def named_columns(header: Sequence[str], setup: Setup, file: str = "") -> Columns:
    """Further columns, or arrays, that the setup names; if the log is one file, all must exist."""
    found: Columns = {}
    for key, name in further_columns(setup.log.columns).items():
        if name in header:
            found[f"{EXTRA_PREFIX}{key}"] = (name,)
        elif not setup.log.files:
            message = "log.columns of the setup names this column, but it is not there"
            raise LogError(message, file=file, field=name, remedy=nearest(name, header))
    return found


def _choose(quantity: str, header: Sequence[str], setup: Setup, optional: Collection[str], file: str) -> Names:
    declared = setup.log.columns.get(quantity, ())
    names = (declared,) if isinstance(declared, str) else declared
    for name in names:
        if name not in header:
            message = f"log.columns.{quantity} of the setup names this column, but it is not there"
            raise LogError(message, file=file, field=name, remedy=nearest(name, header))
    if names:
        return names
    found = _usual(quantity, header, setup)
    native = [match for match in found if match.native]
    if not found:
        # An incomplete set of columns of an optional quantity is a mistake to report.
        if quantity in optional and not some(quantity, header, setup.robot.joint_names):
            return ()
        raise _not_found(quantity, header, setup, file)
    if len(found) > 1 and not native:
        which = " or ".join(f"{match.names[0]} ... {match.names[-1]}" for match in found[:8])
        raise LogError(
            f"several columns may be the {quantity}: {which}", file=file, field=quantity, remedy=_name(quantity)
        )
    match = native[0] if native else found[0]
    _check_facts(match, setup, file)
    return match.names


def _usual(quantity: str, header: Sequence[str], setup: Setup) -> list[Match]:
    """Candidate columns of a quantity by their usual names; for a recorded pose, those of its parts side by side."""
    if setup.pose is None or quantity not in ("position", "velocity"):
        return matches(quantity, header, setup.robot.joint_names)
    parts = [matches(name, header) for name in pose_parts(setup.pose)[quantity]]
    if quantity == "velocity" and not all(parts):
        parts = parts[1:]  # some IMUs have no gyroscope
    found = []
    for choice in product(*parts) if parts else ():
        facts = {key: value for part in choice for key, value in part.facts.items()}
        native = all(part.native for part in choice)
        found.append(Match(sum((part.names for part in choice), ()), facts, native=native))
    return found


def pose_parts(pose: PoseSetup) -> dict[str, Names]:
    """Parts that make up the position and the velocity of a recorded pose: quantities of ``headers.FIXED``."""
    place = ("place",) if pose.linear == "position" else ()
    force = ("accelerometer",) if pose.linear == "specific_force" else ()
    return {"position": (pose.orientation, *place), "velocity": (*(("gyroscope",) if pose.gyroscope else ()), *force)}


def _check_facts(match: Match, setup: Setup, file: str) -> None:
    """Refuse a setup that contradicts the units and axes that follow from the names of the columns."""
    for key, value in match.facts.items():
        stated = getattr(setup.log, key.removeprefix("log."))
        if stated != value and not (stated is None and value == "s"):
            message = f"is {value} by its name, but {key} of the setup is {stated or 'not stated'}"
            remedy = f'state [log] {key.removeprefix("log.")} = "{value}", or name the columns in [log.columns]'
            raise LogError(message, file=file, field=match.names[0], remedy=remedy)


def _name(quantity: str) -> str:
    example = '["...", ...]' if NAMES[quantity] in WIDE else '"..."'
    return f"name them in the setup: [log.columns] {quantity} = {example}"


def _not_found(quantity: str, header: Sequence[str], setup: Setup, file: str) -> LogError:
    wanted = EXAMPLES[quantity]
    if setup.pose is not None and quantity in ("position", "velocity"):
        wanted = " and ".join(" ".join(FIXED[part][0]) for part in pose_parts(setup.pose)[quantity])
    elif quantity == "position":
        wanted += f" ({len(setup.robot.joint_names)} joints: {', '.join(setup.robot.joint_names)})"
    found = ", ".join(header[:40]) + (", ..." if len(header) > 40 else "")
    message = f"no columns for the {quantity}: looked for {wanted}; the header has {found}"
    return LogError(message, file=file, field=quantity, remedy=_name(quantity))
