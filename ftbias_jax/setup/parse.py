"""Parsing of a setup: TOML tables -> frozen dataclasses. Unknown keys are refused, and every value is checked.

[data_noise] states Sigma_D, the covariance of the data matrix D with W = D theta. Uncertainty of the acceleration, the
rate and the direction of gravity at the sensor makes the predicted wrench of the tool uncertain: R = Sigma_W + B
Sigma_D B^T (report, section 3). Its 36 live variances follow from four physical standard deviations
(model/wrench/tool_wrench.py), or are stated one by one.
"""

import difflib
import os
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ftbias_jax.errors import SetupError
from ftbias_jax.setup import types
from ftbias_jax.setup.fields import Section, check_keys, read_only, refuse, require, show, subsection, table, text
from ftbias_jax.setup.keys.table import SECTIONS, TOP, open_section, read, read_all
from ftbias_jax.setup.limits import read_limits
from ftbias_jax.setup.mjcf import Mjcf, load_mjcf, mjcf_robot, mjcf_tool
from ftbias_jax.setup.recorded import OF_ANGLES, POSE, LogSetup, PoseSetup
from ftbias_jax.setup.robots import BUILT_IN, CONVENTIONS, built_in_robot, prismatic_screw, read_dh, revolute_screw
from ftbias_jax.setup.rotations import rotation_from_rpy
from ftbias_jax.setup.urdf import load_urdf, urdf_robot, urdf_tool
from ftbias_jax.types import Array

AXIS_TOLERANCE = 1e-4  # an axis rounded to four digits still means a unit axis; more is a mistake
MAX_GRAVITY = 30.0  # m/s^2: above every planet a robot stands on, below cm/s^2 or mistyped units
NO_INERTIA = 1e-12  # kg m^2, a milligram at a millimetre: the round-off of a point mass
INERTIA_TOLERANCE = 1e-6  # relative to the largest principal moment: inertias printed with seven digits pass
POSE_NAMES = (*(f"orientation {entry}" for entry in "wxyz"), *(f"position {entry}" for entry in "xyz"))
PER_JOINT = ("process_noise_density", "position_noise_std", "velocity_noise_std")
"""Keys of [joints] with an entry for every joint, or for every entry of a recorded pose."""


def parse_setup(mapping: Any, file: str = "") -> types.Setup:
    """Return the setup that is stated by the tables of a TOML text.

    Args:
        mapping: what ``tomllib.loads`` returns, a table by name.
        file: the name in messages.

    Raises:
        SetupError: a key is missing, unknown, of the wrong type or shape, or physically impossible.
    """
    if not isinstance(mapping, Mapping):
        remedy = "give the tables of a TOML text by name; a file is read by ft.load_setup"
        raise SetupError(f"got {type(mapping).__name__}", file=file, field="mapping", remedy=remedy)
    top = check_keys(Section(mapping, "", file), TOP)
    pose = _pose(top)
    scene = _scene(table(top, "robot"))
    robot = _robot(top, pose, scene)
    n = len(robot.joint_names)
    sensor = _sensor(top)
    return types.Setup(
        robot=robot,
        sensor=sensor,
        joints=_joints(top, n, pose),
        log=_log(top, n, pose),
        tool=_tool(top, sensor, scene),
        bias=types.BiasSetup(**read_all(open_section(top, "bias"))),
        data_noise=_data_noise(top),
        effects=_effects(top),
        pose=pose,
        limits=read_limits(top, n),
        path=file,
        description=_path(table(top, "robot"), "urdf") or _path(table(top, "robot"), "mjcf"),
    )


def _pose(top: Section) -> PoseSetup | None:
    """[sensor_pose]; None if it is absent."""
    if "sensor_pose" not in top.values:
        return None
    section = open_section(top, "sensor_pose")
    linear = read(section, "linear")
    if linear != "none":
        refuse(section, ("acceleration_std", "turns_about"), f"excluded by linear = {linear!r}")
    if section.values.get("orientation") in ("matrix", *OF_ANGLES):
        refuse(section, ("frame",), "TF has quaternions", "leave orientation out")
    if "base" in section.values:
        require(section, "frame", "name the frame of TF that the sensor is mounted on")
    names = ("orientation", "position", "angular_velocity", "linear_velocity")
    orientation, position, turn, slide = (read(section, f"{name}_noise_std") for name in names)
    values = read_all(section, ("imu_rotation_rpy", *(f"{name}_noise_std" for name in names)))
    values |= {key: values[key] or "" for key in ("frame", "base")}
    # A small rotation changes the quaternion by half its angle.
    return PoseSetup(
        position_noise_std=_entries(orientation / 2, position, linear),
        velocity_noise_std=_entries(turn / 2, slide, linear),
        imu_rotation=rotation_from_rpy(read(section, "imu_rotation_rpy")),
        **values,
    )


def _entries(turn: float, slide: float, linear: str) -> Array:
    return read_only(np.array([turn] * 4 + [slide] * (0 if linear == "none" else 3)))


def _scene(robot: Section) -> Mjcf | None:
    """The MJCF that the setup names; None if it names none."""
    if "mjcf" not in robot.values:
        return None
    refuse(robot, ("model", "urdf", "tip_link", "dh", "joints", "flange"), "excluded by robot.mjcf")
    return load_mjcf(_path(robot, "mjcf"), read(robot, "site") or "", read(robot, "base_link") or "")


def _robot(top: Section, pose: PoseSetup | None, scene: Mjcf | None) -> types.RobotSetup:
    """[robot]; with a recorded pose it has only gravity, and the entries of the pose take the place of joints."""
    if pose is not None:
        section = subsection(top, "robot", ("gravity",))
        count = 4 if pose.linear == "none" else 7
        screws, translation, rotation = map(read_only, (np.zeros((count, 6)), np.zeros(3), np.eye(3)))
        return types.RobotSetup(screws, POSE_NAMES[:count], translation, rotation, read(section, "gravity"), POSE)
    section = open_section(top, "robot", required=True)
    stated: dict[str, Any] = {key: read(section, key) or "" for key in ("site", "base_link")} if scene else {}
    return replace(_arm(section, scene), name=read(section, "name"), **stated)


def _arm(section: Section, scene: Mjcf | None) -> types.RobotSetup:
    gravity = read(section, "gravity")
    if np.linalg.norm(gravity) > MAX_GRAVITY:
        remedy = f"give m/s^2 in the base frame, at most {MAX_GRAVITY:g} long, such as [0, 0, -9.81]"
        raise section.error("gravity", f"has length {np.linalg.norm(gravity):.4g} m/s^2", remedy)
    if scene is not None:
        return _renamed(mjcf_robot(scene, gravity if "gravity" in section.values else None), section)
    refuse(section, ("site",), "belongs to robot.mjcf", "remove it, or give robot.mjcf")
    if "urdf" in section.values:
        return _urdf_robot(section, gravity)
    refuse(section, ("base_link", "tip_link"), "belongs to robot.urdf", "remove it, or give robot.urdf")
    if "dh" in section.values:
        return _dh_robot(section, gravity)
    refuse(section, ("dh_convention", "dh_units"), "belongs to robot.dh", "remove it, or give robot.dh")
    if "model" not in section.values:
        return _screw_robot(section, gravity)
    model = read(section, "model")
    refuse(section, ("joints", "flange"), f"excluded by robot.model = {model!r}")
    return _renamed(built_in_robot(model, gravity), section)


def _renamed(robot: types.RobotSetup, section: Section) -> types.RobotSetup:
    """The robot with the joint names that recordings use, if the setup states them."""
    if "joint_names" not in section.values:
        return robot
    return replace(robot, joint_names=read(section, "joint_names", len(robot.joint_names)))


def _path(robot: Section, key: str) -> str:
    """Path of the file that robot.urdf or robot.mjcf names, relative to the setup's folder; "" = none."""
    name = read(robot, key)
    return os.path.join(os.path.dirname(robot.file), name) if name else ""


def _urdf_robot(section: Section, gravity: Array) -> types.RobotSetup:
    refuse(section, ("model", "dh", "joints", "joint_names", "flange"), "excluded by robot.urdf")
    require(section, "tip_link", "name the link that is the flange")
    base_link, tip_link = read(section, "base_link") or "", read(section, "tip_link")
    return urdf_robot(load_urdf(_path(section, "urdf")), base_link, tip_link, gravity)


def _dh_robot(section: Section, gravity: Array) -> types.RobotSetup:
    refuse(section, ("model", "joints", "flange"), "excluded by robot.dh")
    require(section, "dh_convention", f"say which, as the table's source does: {' or '.join(CONVENTIONS)}")
    convention = read(section, "dh_convention")
    screws, flange, joint_names = read_dh(section, convention, read(section, "dh_units"))
    translation, rotation = map(read_only, flange)
    return types.RobotSetup(read_only(screws), joint_names, translation, rotation, gravity)


def _screw_robot(section: Section, gravity: Array) -> types.RobotSetup:
    entries = require(section, "joints", f"give [[robot.joints]], robot.dh, or robot.model: {', '.join(BUILT_IN)}")
    if not isinstance(entries, list) or not entries or not all(isinstance(entry, Mapping) for entry in entries):
        raise section.error("joints", f"expected tables, got {show(entries)}", "write one [[robot.joints]] per joint")
    remedy = "write name = ... in each [[robot.joints]]"
    refuse(section, ("joint_names",), "belongs to robot.model and robot.dh", remedy)
    joints = [Section(entry, section.path(f"joints[{i}]"), section.file) for i, entry in enumerate(entries)]
    screws = read_only(np.stack([_screw(joint) for joint in joints]))
    joint_names = tuple(read(joint, "name", default=f"joint{i}") for i, joint in enumerate(joints, 1))
    for joint, name in zip(joints, joint_names, strict=True):
        if joint_names.count(name) > 1:
            raise joint.error("name", f"the name {show(name)} is there twice", "give every joint its own name")
    flange = open_section(section, "flange")
    rotation = read_only(rotation_from_rpy(read(flange, "rotation_rpy")))
    return types.RobotSetup(screws, joint_names, read(flange, "translation"), rotation, gravity)


def _screw(joint: Section) -> Array:
    axis = read(check_keys(joint, SECTIONS["robot.joints"].keys), "axis")
    length = float(np.linalg.norm(axis))
    if abs(length - 1) > AXIS_TOLERANCE:
        raise joint.error("axis", f"has length {length:.6g}", "scale it to length 1")
    if read(joint, "type") == "prismatic":
        read(joint, "point")
        return prismatic_screw(axis / length)
    require(joint, "point", "give 3 numbers, each finite")
    return revolute_screw(axis / length, read(joint, "point"))


def _sensor(top: Section) -> types.SensorSetup:
    section = open_section(top, "sensor")
    correlated = [key for key in ("correlated_std", "correlated_time") if key in section.values]
    if len(correlated) == 1:
        raise section.error(correlated[0], "stands alone", "state correlated_std and correlated_time, or none of them")
    if isinstance(whole := section.values.get("compensated"), bool):  # true is all of the tool's wrench
        section = section._replace(values={**section.values, "compensated": types.COMPENSATED[2 if whole else 0]})
    times = read(section, "rezeroed_at")
    values = read_all(section, ("rezeroed_at",))
    rezeroed_at = () if times is None else tuple(map(float, np.sort(times)))
    rotation = read_only(rotation_from_rpy(read(section, "rotation_rpy")))
    return types.SensorSetup(rotation=rotation, rezeroed_at=rezeroed_at, **values)


def _tool(top: Section, sensor: types.SensorSetup, scene: Mjcf | None) -> types.ToolSetup:
    section = open_section(top, "tool")
    if "from_urdf_link" in section.values:
        return _urdf_tool(section, table(top, "robot"), sensor)
    values = read_all(section, ("from_urdf_link",))
    if scene is not None and not {"mass", "center_of_mass", "inertia"} <= section.values.keys():
        values |= {key: x for key, x in vars(mjcf_tool(scene, sensor)).items() if key not in section.values}
    _check_inertia(values["inertia"], section, "inertia")
    unknown = types.unknown_tool()
    return types.ToolSetup(**{key: getattr(unknown, key) if value is None else value for key, value in values.items()})


def _urdf_tool(section: Section, robot: Section, sensor: types.SensorSetup) -> types.ToolSetup:
    others = [key for key in SECTIONS["tool"].keys if key != "from_urdf_link"]
    refuse(section, others, "excluded by tool.from_urdf_link")
    if "urdf" not in robot.values:
        raise section.error("from_urdf_link", "there is no robot.urdf", "give tool.mass and center_of_mass instead")
    tool = urdf_tool(load_urdf(_path(robot, "urdf")), read(robot, "tip_link"), read(section, "from_urdf_link"), sensor)
    _check_inertia(tool.inertia, section, "from_urdf_link")
    return tool


def _check_inertia(inertia: Array, section: Section, key: str) -> None:
    moments = np.linalg.eigvalsh(types.inertia_matrix(inertia))
    # The largest moment may not exceed the sum of the others; that also makes all three non-negative.
    if moments[2] - moments[1] - moments[0] > max(INERTIA_TOLERANCE * np.abs(moments).max(), NO_INERTIA):
        shown = ", ".join(f"{moment:.4g}" for moment in moments)
        remedy = "no body has them: none may exceed the sum of the others; all zeros = point mass"
        message = f"{show(inertia.tolist())} has the principal moments {shown} kg m^2"
        raise section.error(key, message, remedy)


def _joints(top: Section, n: int, pose: PoseSetup | None) -> types.JointSetup:
    """[joints] for n joints, or for the entries of a recorded pose, which has its own defaults."""
    section = open_section(top, "joints")
    noise = {key: read(section, key, n, getattr(pose, key, None)) for key in PER_JOINT}
    return types.JointSetup(**noise, **read_all(section, PER_JOINT))


def _data_noise(top: Section) -> types.DataNoiseSetup | None:
    """[data_noise]; None if it is absent or everything in it is zero."""
    section = open_section(top, "data_noise")
    if "entries" in section.values:
        refuse(section, tuple(types.DATA_NOISE_UNITS), "excluded by data_noise.entries")
        entries, none = read(section, "entries"), read_only(np.zeros(3))
        return types.DataNoiseSetup(none, none, none, none, entries) if entries.any() else None
    stds = [read(section, key) for key in types.DATA_NOISE_UNITS]
    return types.DataNoiseSetup(*stds) if np.any(stds) else None


def _log(top: Section, n: int, pose: PoseSetup | None) -> LogSetup:
    position, velocity = pose.columns if pose else (n, n)
    sizes = {"position": position, "velocity": velocity}
    log = open_section(top, "log")
    known = SECTIONS["log.columns"].keys
    names = [key for key, spec in SECTIONS["log"].keys.items() if not spec.has_value and key != "columns"]
    sections = {key: open_section(log, key) for key in names}
    tables = {name: {key: read(part, key) for key in part.values} for name, part in sections.items()}
    files = tables["files"]
    if files and not {"position", "wrench"} <= files.keys():
        raise log.error("files", f"names {', '.join(files)}", "name the files of position and wrench")
    for key, name in files.items():
        if "\0" in name:  # system calls refuse it with different errors
            raise sections["files"].error(key, f"has a zero byte in {name!r}", "give the name of a file")
    if files and (others := sorted(tables["time_offsets"].keys() - files.keys())):
        remedy = "state the offset of the file that has them"
        raise log.error("time_offsets", f"names {', '.join(others)}, which has no file in log.files", remedy)
    part = subsection(log, "columns", _column_keys(log, known))
    columns = {key: read(part, key, sizes.get(key)) if key in known else text(part, key, "") for key in part.values}
    stated = {**tables, **read_all(log, ("columns", *tables))}
    return LogSetup(columns, **stated)


def _column_keys(log: Section, known: Collection[str]) -> tuple[str, ...]:
    """Keys that [log.columns] may have: known ones, and any identifier that does not nearly match one of them."""
    given = log.values.get("columns")
    further = (key for key in given if key not in known) if isinstance(given, Mapping) else ()
    return (*known, *(key for key in further if key.isidentifier() and not difflib.get_close_matches(key, known)))


def _effects(top: Section) -> dict[str, Any]:
    section = table(top, "effects")
    several = {name: value for name, value in section.values.items() if name == "term" and isinstance(value, list)}
    return {name: dict(table(section, name).values) for name in section.values if name not in several} | several
