"""Draft of a setup from a robot's name, a URDF, an MJCF or a log: all that they state, and what is left to measure."""

import os
import tempfile
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import LogError, UsageError
from ftbias_jax.io import read_recorded
from ftbias_jax.io.cleaning import clean
from ftbias_jax.io.draft.conventions import (
    Read,
    Reading,
    accelerometer,
    best_reading,
    gyroscope,
    position_axes,
    ways_of,
)
from ftbias_jax.io.draft.dh_table import DhTable, from_table
from ftbias_jax.io.draft.evidence import quietest_noise, scatter_in_motion, tool_keys, weigh
from ftbias_jax.io.draft.robot import (
    Keys,
    built_in,
    from_mjcf,
    from_urdf,
    look_into,
    mounting,
    renamed,
    robots_with,
    sensor_frame,
)
from ftbias_jax.io.draft.rows import time_unit
from ftbias_jax.io.draft.table import Table, left_to_choose, look, patterns, stated_columns
from ftbias_jax.io.log import Log
from ftbias_jax.io.pose import sensor_rotations
from ftbias_jax.io.ros.record import is_ros
from ftbias_jax.io.tables.column_names import TO_NAME
from ftbias_jax.io.tables.headers import are_counted
from ftbias_jax.io.tables.poses import Poses, as_log, read_poses
from ftbias_jax.setup.dump import MEASURE, Known, write_template
from ftbias_jax.setup.mjcf import load_mjcf, mjcf_robot
from ftbias_jax.setup.parse import parse_setup
from ftbias_jax.setup.require import orientation_alone
from ftbias_jax.setup.rotations import vector_from_rotation
from ftbias_jax.setup.types import Setup
from ftbias_jax.setup.urdf import load_urdf

GUESS = Known([0.1, 0.004], f"a guess: {MEASURE}")
"""N, Nm: noise of a typical wrist sensor, used where no log shows it."""
ABOUT = """Setup of a robot with a force-torque sensor, drafted by ftbias setup{source}.
What says "{measure}" is not known; lines behind a # show other keys with their defaults.
Next: ftbias info LOG --setup {file} says what the log can show, and which command goes on from there."""


class Request(NamedTuple):
    """Input from which a setup is drafted."""

    logs: Sequence[str] = ()
    """Files of one log: a single one, or several with one stream each."""
    robot: str = ""
    """Name of a built-in robot."""
    urdf: str = ""
    mjcf: str = ""
    site: str = ""
    base_link: str = ""
    tip_link: str = ""
    dh: DhTable | None = None
    mass: float | None = None
    """kg."""
    center_of_mass: Sequence[float] | None = None
    """(3,) m, sensor frame."""
    rate: float | None = None
    """Hz, of a log without stamps."""
    output: str = "setup.toml"
    further: Mapping[str, Known] = {}
    """Keys that a check of the first draft has found."""


class Draft(NamedTuple):
    """Text of a drafted setup, and what belongs to it."""

    text: str
    urdf: str
    """Text of a URDF that the recording had, to be written beside the setup; "" = none."""
    notes: tuple[str, ...]
    """One line each: what was found out, and what was not."""
    setup: Setup
    log: Log | Poses | None
    """The log as the setup reads it, for a check of the draft; None = there is none, or columns are left to choose."""


def draft(request: Request) -> Draft:
    """Draft a setup.

    Raises:
        UsageError: the robot is not named, or is named twice. LogError, SetupError: a file cannot be read.
    """
    if sum(map(bool, (request.robot, request.urdf, request.mjcf, request.dh))) > 1:
        raise UsageError("the robot is named twice", field="--robot, --urdf, --mjcf, --dh", remedy="keep one of them")
    with _folder(request) as folder:
        file = os.path.join(folder, Path(request.output).name)
        keys, urdf, tables = _of_robot(request, folder)
        if request.mass is not None:
            keys["tool.mass"] = Known(request.mass, "as stated")
        if request.center_of_mass is not None:
            keys["tool.center_of_mass"] = Known(list(request.center_of_mass), "as stated")
        if request.rate is not None:
            keys["log.rate"] = Known(request.rate, "as stated")
        keys |= request.further
        stated = {"sensor.noise_std": GUESS} | keys
        notes, log = list[str](), None
        if request.logs:
            found, notes, log = _of_log(stated, request.logs[0], tables, file)
            mine = {f"{key}_std" for key in keys}  # a stated value does not have the estimate's error
            stated = {"sensor.noise_std": GUESS} | {key: x for key, x in found.items() if key not in mine} | keys
        source = f" from {', '.join(Path(log).name for log in request.logs)}" if request.logs else ""
        about = ABOUT.format(source=source, measure=MEASURE, file=Path(request.output).name)
        text = write_template(stated, about)
        setup = parse_setup(tomllib.loads(text), file)
    if request.robot and not any(key.startswith("robot.") for key in stated):
        notes = ["--robot is not needed: the log has the sensor's pose, and no joints", *notes]
    notes += [f"not known: {', '.join(f'tool.{key}' for key in setup.tool.unknown)}"] if setup.tool.unknown else []
    return Draft(text, urdf, tuple(notes), setup, log)


def urdf_beside(output: str) -> str:
    """Path of the file for a recording's URDF."""
    return str(Path(output).with_suffix(".urdf"))


@contextmanager
def _folder(request: Request) -> Iterator[str]:
    """Folder of the setup's relative paths; a temporary one for a recording, because its URDF is not written yet."""
    if request.robot or request.urdf or request.mjcf or request.dh:
        yield os.path.dirname(os.path.abspath(request.output))
        return
    with tempfile.TemporaryDirectory() as folder:
        yield folder


def _of_robot(request: Request, folder: str) -> tuple[Keys, str, list[Table]]:
    """Keys of robot, mounting and topics; the URDF of the recording, if it is needed; the content of tables."""
    links = (request.base_link, request.tip_link)
    stated = from_table(request.dh) if request.dh else from_urdf(request.urdf, *links, folder) if request.urdf else {}
    if request.mjcf:
        stated = from_mjcf(request.mjcf, request.base_link, request.site, folder)
    if len(request.logs) != 1 or not is_ros(request.logs[0]):
        tables = [look(path) for path in request.logs]
        has_pose = any(table.orientation for table in tables)  # then no robot need be known
        if not stated and not (has_pose and (not request.robot or not any(table.joints for table in tables))):
            if not request.robot and (unnamed := [table.path for table in tables if are_counted(table.header)]):
                raise LogError("its columns have no names", file=unnamed[0], remedy=f"{TO_NAME}, or name the robot")
            names = next((table.names for table in tables if table.names), ())
            by_columns = any(table.header for table in tables)  # then [log.columns] gives their order
            stated = built_in(_named(request, names), () if by_columns else names)
        return stated, "", tables
    recorded = look_into(request.logs[0])
    urdf = "" if request.robot or stated else recorded.description
    if urdf:
        path = os.path.join(folder, Path(urdf_beside(request.output)).name)
        Path(path).write_text(urdf, encoding="utf-8")
        stated = from_urdf(path, *links, folder)
    stated = stated or built_in(_named(request, recorded.joints), recorded.joints)
    if request.mjcf:
        theirs = mjcf_robot(load_mjcf(request.mjcf, request.site, request.base_link)).joint_names
        return {**renamed(stated, theirs, recorded.joints, Path(request.mjcf).name), **recorded.keys}, "", []
    mounted: Keys = {}
    if "robot.urdf" in stated and recorded.frame:
        mounted = mounting(load_urdf(request.urdf or path), str(stated["robot.tip_link"].value), recorded.frame)
    return {**stated, **(mounted or sensor_frame(recorded)), **recorded.keys}, urdf, []


def _named(request: Request, recorded: Sequence[str]) -> str:
    """Name of the built-in robot, as requested or found by the recorded joints."""
    if request.robot:
        return request.robot
    found = robots_with(recorded)
    if len(found) == 1:
        return found[0]
    words = f"the joints are those of {', '.join(found)}" if found else "which robot is it?"
    raise UsageError(words, field="--robot", remedy="name a built-in robot, or give --urdf, --mjcf or --dh FILE")


def _of_log(stated: Keys, path: str, tables: Sequence[Table], file: str) -> tuple[Keys, list[str], Log | Poses | None]:
    """Keys from a log: how it was recorded, the noise and the sign of the sensor, and the tool by its weight."""
    static = len(tables) == 1 and tables[0].static and "log.rate" not in stated
    keys = {} if static else _of_tables(tables)
    has_pose = any(table.orientation for table in tables) and not any(key.startswith("robot.") for key in stated)
    joints = None if has_pose else parse_setup(tomllib.loads(write_template(stated)), file).robot.joint_names
    for table in tables:
        keys |= stated_columns(table, joints)
    if left := left_to_choose(tables, timed=not static and "log.rate" not in stated):
        what = " and ".join(key.rpartition(".")[2] for key in left)
        rate = ", or give --rate HZ if it has no stamps" if "log.columns.time" in left else ""
        words = f"which columns are {what} does not show by their names: fill in [log.columns]{rate}"
        return keys | left, [words], None

    def read(further: Keys) -> tuple[Setup, Log]:
        text = write_template({**stated, **keys, **further})
        setup = parse_setup(tomllib.loads(text), file)
        if static:
            return orientation_alone(setup), as_log(read_poses(path, setup))
        return setup, clean(read_recorded(path, setup, salvage=True), file=path)

    best: Reading | None = None
    if has_pose:
        body = next(table for table in tables if table.orientation)
        keys |= {"sensor_pose.linear": Known("none"), "sensor_pose.orientation": Known(body.orientation)}
        if not any("gyroscope" in table.has for table in tables):
            keys["sensor_pose.gyroscope"] = Known(False, "none is recorded")
        best = best_reading(ways_of(body), read)
        keys |= best.keys if best else {}
        keys |= {} if static else _of_motion(tables, body, best, read)
    elif tables and "log.angle_unit" not in keys and max(table.joints for table in tables):
        keys |= _joint_units(read)
    setup, log = read({})
    rotations, notes = sensor_rotations(log.t, log.q, setup, path), []
    if best and (angle := np.degrees(np.linalg.norm(vector_from_rotation(best.mount)))):
        rotations = rotations @ best.mount
        turned = f"the recorded frame is turned about {angle:.0f} degrees relative to the sensor"
        notes.append(f"{turned}: ftbias identify --mounting finds how")
    noise = quietest_noise(log.t, log.wrench, rotations)
    unseen = "static poses do not show it" if static else "the log has no stretch of rest that shows it"
    notes += [] if noise else [f"the sensor's noise is a guess: {unseen}"]
    if tilted := keys.get("robot.gravity"):
        notes.append(f"robot.gravity {tilted.value}: {tilted.remark}")
    if noise:
        keys["sensor.noise_std"] = Known(*noise)
    found = weigh(log.t, rotations, setup.robot.gravity, log.wrench, log.rezeroed_at)
    if noise and found and found.credible and setup.pose is not None and setup.pose.linear == "none":
        weight = -found.mass * np.einsum("tji,j->ti", rotations, setup.robot.gravity)
        scatter = scatter_in_motion(log.t, log.wrench[:, :3] - weight, rotations, np.array(noise[0][:3]))
        if scatter is not None:
            std = float(f"{scatter / abs(found.mass):.2g}")
            keys["sensor_pose.acceleration_std"] = Known(std, "of the scatter of the forces in motion")
    of_tool, more = tool_keys(found, "tool.mass" in stated)
    return {**keys, **of_tool}, [*notes, *more], read_poses(path, setup) if static else log


def _of_tables(tables: Sequence[Table]) -> Keys:
    """Keys of a setup for files and units of time."""
    keys: Keys = {}
    roles = patterns(tables) if len(tables) > 1 else {}
    keys |= {f"log.files.{role}": Known(pattern) for role, pattern in roles.items()}
    timed = {role: table.time for role, table in zip(roles or ["log"], tables, strict=False) if table.time is not None}
    units = {role: time_unit(time) for role, time in timed.items() if len(time) > 1}
    remark = "by the rate and the date"
    if len(set(units.values())) == 1 and (unit := next(iter(units.values()))):
        keys["log.time_unit"] = Known(unit, remark)
    elif any(units.values()):
        usual = {role: "s" if timed[role].dtype.kind == "f" else "ns" for role in units}
        keys |= {f"log.time_units.{role}": Known(unit or usual[role], remark) for role, unit in units.items()}
    return keys


def _of_motion(tables: Sequence[Table], body: Table, best: Reading | None, read: Read) -> Keys:
    """Keys for the source of the acceleration, and for whether a gyroscope is credible."""
    keys = gyroscope(read) if any("gyroscope" in table.has for table in tables) else {}
    imu = next((table for table in tables if table.accelerometer is not None), None)
    if imu is not None:
        keys |= accelerometer(imu, lambda more: read({**keys, **more}))
    if "place" in body.has and best and "sensor_pose.linear" not in keys:
        keys |= position_axes(lambda more: read({**keys, **more}), best)
    return keys


def _joint_units(read: Read) -> Keys:
    """Keys that state degrees and mm, if joints exceed their limits in rad and m by far.

    Less than a turn beyond the limits is another robot, or another zero of its joints: in degrees, such a joint would
    hardly move.
    """
    setup, log = read({})
    if not np.isfinite(log.q).any():
        return {}
    stated = setup.robot.position_limits
    limits = np.full((log.q.shape[1], 2), np.inf) if stated is None else stated
    most = np.where(np.isfinite(limits), np.abs(limits), 4 * np.pi).max(1) + 0.5
    turns = setup.robot.revolute
    beyond = np.nanmax(np.abs(log.q), 0) > np.where(turns, np.maximum(most, 2 * np.pi), 10 * most)
    keys: Keys = {}
    if (beyond & turns).any():
        keys["log.angle_unit"] = Known("deg", "because joints are beyond their limits in rad")
    if (beyond & ~turns).any():
        keys["log.length_unit"] = Known("mm", "because prismatic joints are far beyond their limits in m")
    return keys
