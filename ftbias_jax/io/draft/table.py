"""Content of a table or a file of arrays that no setup describes, and the keys of a setup that its names imply."""

from collections.abc import Mapping, Sequence, Set
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError
from ftbias_jax.io.draft.rows import in_degrees, is_static
from ftbias_jax.io.ros.messages import JOINTS, POSE, TEMPERATURE, WRENCH
from ftbias_jax.io.ros.record import Wanted, is_ros, read_recording
from ftbias_jax.io.tables.arrays import (
    ARRAY_FILES,
    ARRAYS,
    COLUMNS,
    POSE_ARRAYS,
    TABLES,
    array_columns,
    suffix_of,
)
from ftbias_jax.io.tables.columns import Columns
from ftbias_jax.io.tables.headers import Match, matches, some
from ftbias_jax.io.tables.streams import unknown_format
from ftbias_jax.setup.dump import Known
from ftbias_jax.setup.recorded import OF_ANGLES
from ftbias_jax.types import Array

WIDTHS = {3: "axis_angle", 9: "matrix", 4: "quaternion_xyzw"}
"""Numbers per orientation -> its usual format."""
ALSO = {"axis_angle": "rpy", "quaternion_xyzw": "quaternion_wxyz"}
"""Format -> another one with the same numbers, of which names may not say which it is."""
ORIENTATIONS = ("quaternion_xyzw", "matrix", "axis_angle", "rpy")
"""Possible formats of an orientation whose columns are known by their names."""
QUANTITIES = ("time", "position", "velocity", "wrench", "temperature")
"""Keys of [log.columns]."""
PARTS = {"position": "place", "angular_velocity": "gyroscope", "specific_force": "accelerometer"}
"""Array of a pose or an IMU -> name of the quantity for its columns."""
MOST_LISTED = 60
"""Maximum number of columns that are listed to choose from."""


class Table(NamedTuple):
    """Content of one file."""

    path: str
    has: Set[str] = frozenset()
    """Quantities of QUANTITIES and PARTS in the file; see below for time, joints and orientation."""
    time: Array | None = None
    """(T,) stamps as stored; None = none."""
    joints: int = 0
    """How many joints have positions."""
    orientation: str = ""
    """One of ORIENTATIONS, or "" = none."""
    named: bool = True
    """Whether the names of columns show which entry of the orientation each one is."""
    degrees: bool = False
    """Whether the orientation has angles that must be in degrees."""
    accelerometer: Array | None = None
    """(T, 3) as stored; None = none."""
    others: tuple[str, ...] = ()
    """Names of columns or arrays that are not used."""
    names: tuple[str, ...] = ()
    """Names of the joints in a ROS recording or a header."""
    header: tuple[str, ...] = ()
    """Names of all columns of a table that has columns."""
    found: Mapping[str, Match] = {}
    """Quantity -> the columns that most likely hold it, by their names."""
    static: bool = False
    """Whether the rows can be static poses, one reading each; without stamps, a stated rate makes them a log."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints in the file, or q0, q1, ..."""
        return self.names or tuple(f"q{i}" for i in range(self.joints))

    @property
    def has_imu(self) -> bool:
        """Whether it has a gyroscope or an accelerometer."""
        return bool(self.has & {"gyroscope", "accelerometer"})


def look(path: str) -> Table:
    """Examine the content of a file."""
    suffix = suffix_of(path)
    if is_ros(path):
        return _of_recording(path)
    if suffix not in TABLES:
        raise unknown_format(path)
    of_arrays = _of_arrays(path, ARRAY_FILES[suffix](path, (*ARRAYS, *POSE_ARRAYS))) if suffix in ARRAY_FILES else None
    if of_arrays and _halves(of_arrays) == 2:
        return of_arrays
    header: list[str] = []
    found: dict[str, Match] = {}

    def choose(names: Sequence[str]) -> Columns:
        header.extend(names)
        likely = {name: likeliest(matches(name, names)) for name in (*QUANTITIES, *PARTS.values(), *ORIENTATIONS)}
        found.update({name: match for name, match in likely.items() if match})
        joints = found["position"].names if "position" in found else ()
        for name in [name for name in ORIENTATIONS if name in found]:
            names_of_it = found[name].names
            of_joints = len(joints) > len(names_of_it) and set(names_of_it) <= set(joints)  # q1 to q4 of six joints
            if of_joints or (max(map(len, names_of_it)) == 1 and "place" not in found):  # a, b, c alone may be anything
                del found[name]
        moved = next((name for name in (*ORIENTATIONS, "position") if name in found), "")
        wanted = {"t": "time", "q": moved, "dq": "accelerometer"}
        return {array: found[name].names if name in found else () for array, name in wanted.items()}

    of_columns = _of_columns(path, header, found, COLUMNS.get(suffix, array_columns)(path, choose))
    return of_arrays if of_arrays and _halves(of_arrays) >= _halves(of_columns) else of_columns


def _halves(table: Table) -> int:
    """Number of parts of a log in the file: motion, a wrench, or both."""
    return bool(table.joints or table.orientation) + ("wrench" in table.has)


def likeliest(candidates: Sequence[Match]) -> Match | None:
    """Candidate columns of a quantity that have exactly the usual names, or else the first; None = no candidates."""
    return next((match for match in candidates if match.native), candidates[0] if candidates else None)


def _of_recording(path: str) -> Table:
    """Content of a ROS recording that is one of several files; its stamps need no unit."""
    streams = read_recording(path, salvage=True, wanted=Wanted(poses=True)).streams
    roles = {stream.role for stream in streams}
    arm = max((stream for stream in streams if stream.role == JOINTS), key=lambda x: len(x.names), default=None)
    names = () if arm is None else arm.names or tuple(f"q{i}" for i in range(arm.values.shape[1] // 2))
    pose = POSE in roles and not names
    return Table(
        path=path,
        has=(roles & {WRENCH, TEMPERATURE}) | ({"place"} if pose else set()),
        joints=len(names),
        orientation="quaternion_xyzw" if pose else "",
        names=() if arm is None else arm.names,
    )


def _of_arrays(path: str, arrays: Mapping[str, Array]) -> Table:
    orientation = arrays.get("orientation")
    width = 0 if orientation is None else int(np.prod(np.shape(orientation)[1:]))
    time = arrays.get("t", arrays.get("t_wrench"))
    time = None if time is None or np.ndim(time) != 1 else np.asarray(time)
    motion = arrays.get("q") if orientation is None else orientation
    return Table(
        path=path,
        has={PARTS.get(name, name) for name in arrays},
        time=time,
        joints=np.shape(arrays["q"])[1] if "q" in arrays and np.ndim(arrays["q"]) == 2 else 0,
        orientation=WIDTHS.get(width, ""),
        named=width == 9,
        degrees=width == 3 and in_degrees(orientation),
        accelerometer=arrays.get("specific_force"),
        static=is_static(time, motion),
    )


def _of_columns(path: str, header: Sequence[str], found: Mapping[str, Match], values: Mapping[str, Array]) -> Table:
    """Content by the names of all columns; ``values`` has stamps "t", motion "q" and accelerometer "dq"."""
    used = {name for match in found.values() for name in match.names}
    for name in (name for name in dict.fromkeys(header) if header.count(name) > 1):
        if some("position", [name], ()) or name in used:
            message = f"two columns {'have this name' if name in used else 'are of this joint'}"
            raise LogError(message, file=path, field=name, remedy="rename one of them")
    kind = next((kind for kind in ORIENTATIONS if kind in found), "")
    other = found.get(ALSO.get(kind, ""))
    return Table(
        path=path,
        has=found.keys(),
        time=values.get("t"),
        joints=len(found["position"].names) if "position" in found else 0,
        orientation=kind,
        named=other is None or other.names != found[kind].names,
        degrees=kind in OF_ANGLES and in_degrees(values.get("q")),
        accelerometer=values.get("dq"),
        others=tuple(name for name in header if name not in used),
        names=found["position"].joints if "position" in found else (),
        header=tuple(header),
        found=found,
        static=is_static(values.get("t"), values.get("q")),
    )


def patterns(tables: Sequence[Table]) -> dict[str, str]:
    """[log.files] of several tables: what all names begin with becomes the *."""
    names = [Path(table.path).name for table in tables]
    shared = next(i for i, letters in enumerate(zip(*names, strict=False)) if len(set(letters)) > 1)
    found: dict[str, str] = {}
    for table in tables:
        moves = bool(table.orientation or table.joints)
        roles = {"position": moves, "wrench": "wrench" in table.has, "velocity": table.has_imu}
        roles["temperature"] = "temperature" in table.has
        role = next((name for name, there in roles.items() if there), "")
        if not role or role in found:
            what = f"has {role} too" if role else "has neither joints, pose, wrench nor an IMU"
            raise LogError(what, file=table.path, remedy="give one file for each stream")
        found[role] = f"*{Path(table.path).name[shared:]}"
    return found


def stated_columns(table: Table, joints: Sequence[str] | None = None) -> dict[str, Known]:
    """Keys of a setup that column names imply: [log.columns] for names that are not the usual ones, and units.

    ``joints`` are the joint names in the order of the columns; None = in the order of the header.
    """
    keys: dict[str, Known] = {}
    for quantity in (*QUANTITIES, *PARTS.values(), table.orientation):
        candidates = _candidates(quantity, table, joints)
        match = likeliest(candidates)
        if match is None:
            continue
        for key, value in match.facts.items():
            keys[key] = Known(value, f"by the name of the column {match.names[0]}")
        if quantity in QUANTITIES and not match.native:
            if table.orientation and quantity in ("position", "velocity"):
                continue  # both come from a pose and an IMU, whose columns the reader finds by [sensor_pose]
            names = match.names[0] if quantity in ("time", "temperature") else list(match.names)
            keys[f"log.columns.{quantity}"] = Known(names, _remark(match, candidates, joints))
    return keys


def left_to_choose(tables: Sequence[Table], timed: bool = True) -> dict[str, Known]:
    """Keys of [log.columns] without a value, for quantities that no names show, with the columns to choose from.

    Missing stamps matter only if the tables must be ``timed``.
    """
    tables_of_columns = [table for table in tables if table.header]
    found = {
        "time": not timed or all("time" in table.found for table in tables_of_columns),
        "position": any(table.joints or table.orientation for table in tables),
        "wrench": any("wrench" in table.has for table in tables),
    }
    others = [name for table in tables for name in table.others]
    listed = ", ".join(others[:MOST_LISTED]) + (f" and {len(others) - MOST_LISTED} more" * (len(others) > MOST_LISTED))
    missing = [quantity for quantity, there in found.items() if tables_of_columns and not there]
    return {f"log.columns.{quantity}": Known(None, f"choose from {listed or 'nothing'}") for quantity in missing}


def _candidates(quantity: str, table: Table, joints: Sequence[str] | None) -> list[Match]:
    """Columns that may hold a quantity; for joints with other names than the robot's, as many as it has joints."""
    found = matches(quantity, table.header, joints)
    if found or joints is None or quantity not in ("position", "velocity"):
        return found
    return [match for match in matches(quantity, table.header) if len(match.names) == len(joints)]


def _remark(match: Match, candidates: Sequence[Match], joints: Sequence[str] | None) -> str:
    remarks = []
    if match.joints and joints is not None and tuple(joints) != match.joints:
        remarks.append("in the order of the header: check it")
    if others := ", ".join(f"{other.names[0]} ..." for other in candidates if other is not match):
        remarks.append(f"also there: {others}")
    return "; ".join(remarks)
