"""Options of an export, and the tool as the payload of a controller.

Controllers of Universal Robots and Franka take it in the frame of the robot's own flange.
"""

import hashlib
import json
import os
import tomllib
from collections.abc import Collection
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax import __version__
from ftbias_jax.errors import SetupError, printable
from ftbias_jax.setup.bodies import RigidBody, joined
from ftbias_jax.setup.recorded import POSE
from ftbias_jax.setup.require import require_tool
from ftbias_jax.setup.robots import built_in_robot, with_makers_flange
from ftbias_jax.setup.save import edited_text
from ftbias_jax.setup.types import SCREWS, Setup, inertia_matrix
from ftbias_jax.types import Array


class ExportOptions(NamedTuple):
    """What an export needs and a setup does not state."""

    sensor_mass: tuple[float, float, float, float] | None = None
    """kg, and m in the robot's flange frame: mass and centre of mass of what is between flange and sensor, such as the
    sensor's own body. The robot carries it, the sensor does not feel it."""
    frames_as_stated: bool = False
    """Whether the flange of a setup with a URDF or a list of joints is the tool flange of the robot's controller, and a
    mounting of the sensor that the setup does not state is zero."""
    sensor_frame: str = "ft_sensor"
    """Frame of TF that the sensor publishes in."""
    world_frame: str = ""
    """Frame of TF that is the setup's base frame; "" = that of the robot's maker."""


DEFAULT = ExportOptions()
OF_TOOL = {"tool_mass": "mass", "tool_com": "center_of_mass", "tool_inertia": "inertia"}
"""Effect -> its parameter, which replaces the key of [tool] with the same name."""
PLACE, PLACE_KEY = "mount_translation", "sensor.translation"
"""Effect whose parameter, in sensor axes, is added to the place of the sensor in the flange frame."""


def with_effects_in_keys(setup: Setup, keep: Collection[str] = ()) -> Setup:
    """The same model, with what effects change of the tool and of the sensor's place in [tool] and [sensor].

    Args:
        setup: setup with effects such as a diagnosis writes.
        keep: effects that stay as they are.
    """
    found = {effect: key for effect, key in OF_TOOL.items() if effect in setup.effects and effect not in keep}
    values: dict[str, Any] = {key: setup.effects[effect][key] for effect, key in found.items()}
    values = {key: np.asarray(x, float) if np.ndim(x) else float(x) for key, x in values.items()}
    sensor, keys = setup.sensor, {effect: f"tool.{key}" for effect, key in found.items()}
    if PLACE in setup.effects and PLACE not in keep and setup.pose is None:
        shift = np.asarray(setup.effects[PLACE]["translation"], float)
        sensor, keys[PLACE] = replace(sensor, translation=sensor.translation + sensor.rotation @ shift), PLACE_KEY
    if not keys:
        return setup
    rest = {name: effect for name, effect in setup.effects.items() if name not in keys}
    comments = dict(setup.comments)
    for effect, key in keys.items():
        comments[key] = comments.pop(f"effects.{effect}.{key.rpartition('.')[2]}", "of the setup's effects")
    return replace(setup, tool=replace(setup.tool, **values), sensor=sensor, effects=rest, comments=comments)


def heading(setup: Setup) -> list[str]:
    """Header lines of an export: program, setup with its SHA-256, and remarks on how the tool was found."""
    digest = hashlib.sha256(edited_text(setup).encode()).hexdigest()
    name = os.path.basename(setup.path) or "a setup in memory"
    words = [f"by ftbias_jax {__version__} from {name}, sha256 {digest}"]
    words += [f"{key}: {remark}" for key, remark in setup.comments.items() if key.startswith("tool.")]
    if setup.effects:
        words.append(f"not in these numbers: the effects of the setup ({', '.join(setup.effects)})")
    return [printable(line) for line in words]


def plain(values: Array) -> list[float]:
    """Numbers with twelve digits, or fifteen decimals, and no minus zero."""
    return [round(float(f"{float(value):.12g}"), 15) + 0.0 for value in values]


def number(value: float) -> str:
    """Format a number with a point and without an exponent: YAML 1.1, which ROS reads, takes "1e-05" for text."""
    return str(np.format_float_positional(plain([value])[0], trim="0"))


def numbers(values: Array) -> str:
    """Format numbers as a list for YAML and URScript."""
    return f"[{', '.join(map(number, values))}]"


class Maker(NamedTuple):
    """A manufacturer of arms whose flange a payload refers to."""

    name: str
    models: tuple[str, ...]
    """Prefixes of the names of its built-in robots."""
    link: str
    """Suffix of the name of the URDF link that is its flange."""


UR = Maker("Universal Robots", ("ur",), "tool0")
FRANKA = Maker("Franka", ("panda", "fr3"), "link8")


def ur_text(setup: Setup, options: ExportOptions) -> str:
    """URScript that sets the payload.

    ``set_target_payload(m, cog, inertia)`` of the script manual (SW 5.11 and newer): kg; m from the tool mount, in the
    tool flange frame; [Ixx, Iyy, Izz, Ixy, Ixz, Iyz] kg m^2 about the centre of gravity, axes of the flange.
    https://www.universal-robots.com/manuals/EN/HTML/SW10_6/Content/prod-scriptmanual/G5/set_target_payload.htm
    """
    mass, center, inertia = payload_of(setup, UR, options)
    cog = numbers(center)
    six = numbers([inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))])
    between = ", and what was given between flange and sensor" if options.sensor_mass else ""
    lines = [
        *heading(setup),
        "kg; m in the tool flange frame; kg m^2 about the centre of gravity, axes of the flange: xx yy zz xy xz yz",
        f"everything distal of the sensor{between}",
        "the robot zeroes its own force-torque reading when it runs this",
        f"older software: set_payload({number(mass)}, {cog})",
    ]
    return "".join(f"# {line}\n" for line in lines) + f"set_target_payload({number(mass)}, {cog}, {six})\n"


def franka_text(setup: Setup, options: ExportOptions) -> str:
    """JSON (which is YAML, too) with the arguments of ``setLoad``.

    ``franka::Robot::setLoad(load_mass, F_x_Cload, load_inertia)`` of libfranka: kg; centre of mass in the flange frame
    (link 8), m; inertia about the centre of mass, kg m^2, 3 x 3, column by column (frankaemika/libfranka, robot.h and
    robot_state.h). The request of franka_msgs/SetLoad has the same numbers under names of its own
    (https://docs.ros.org/en/humble/p/franka_msgs/srv/SetLoad.html).
    """
    mass, center, inertia = payload_of(setup, FRANKA, options)
    load = {"mass": plain([mass])[0], "F_x_Cload": plain(center), "load_inertia": plain(inertia.ravel(order="F"))}
    words = [
        *heading(setup),
        "kg; m in the flange frame (link 8); kg m^2 about the centre of mass, column by column",
        "the load comes on top of the end effector that Desk is set to: set none there",
    ]
    request = {"mass": load["mass"], "center_of_mass": load["F_x_Cload"], "load_inertia": load["load_inertia"]}
    return json.dumps({"about": words, "setLoad": load, "franka_msgs/SetLoad": request}, indent=1) + "\n"


def payload_of(setup: Setup, maker: Maker, options: ExportOptions) -> RigidBody:
    """The tool, and what is between flange and sensor, in the frame of the maker's flange.

    v_flange = R v_sensor turns vectors; a point c of the sensor frame is at R c + p, and the inertia about the centre
    of mass becomes R I R'. Two bodies are joined by the parallel axis theorem.

    Raises:
        SetupError: the setup does not state the tool, its robot is another maker's, or a transform is not known.
    """
    tool = require_tool(setup).tool
    if not options.frames_as_stated:
        _check_mounting(setup)
    turned, moved = _flange(setup, maker, options)
    sensor = setup.sensor
    rotation, position = turned @ sensor.rotation, turned @ sensor.translation + moved
    in_sensor = RigidBody(tool.mass, tool.center_of_mass, inertia_matrix(tool.inertia))
    payload = in_sensor.seen_from(rotation.T, -rotation.T @ position)
    if options.sensor_mass is None:
        return payload
    mass, *center = options.sensor_mass
    return joined(payload, RigidBody(mass, np.array(center), np.zeros((3, 3))))


def _check_mounting(setup: Setup) -> None:
    """Raise an error if the mounting of the sensor is not stated, even if zero: a default is no measurement."""
    sensor, written = setup.sensor, _said(setup, "sensor")
    nowhere = not sensor.translation.any() and np.allclose(sensor.rotation, np.eye(3))
    if nowhere and not {"translation", "rotation_rpy"} & written.keys():
        remedy = "state translation (m) and rotation_rpy (rad) of the sensor in the flange frame, also if they are zero"
        raise SetupError("the mounting of the sensor is not stated", file=setup.path, field="sensor", remedy=remedy)


def _flange(setup: Setup, maker: Maker, options: ExportOptions) -> tuple[Array, Array]:
    """Rotation and position (m) of the setup's flange in that of the maker."""
    model, here = setup.robot.model, (np.eye(3), np.zeros(3))
    if model == POSE:
        remedy = "use a setup with the robot's joints, or the formats ros and ft_calib, which do without"
        raise SetupError("a recorded pose has no flange", file=setup.path, field="sensor_pose", remedy=remedy)
    if model == SCREWS:
        tip = str(_said(setup, "robot").get("tip_link", ""))
        if tip.endswith(maker.link) or options.frames_as_stated:
            return here
        remedy = "if the flange of the setup is that of its controller, say so: --frames-as-stated"
        message = f"the tool flange of {maker.name} is not known in this setup"
        field = "robot.tip_link" if tip else "robot.flange"
        raise SetupError(message, file=setup.path, field=field, remedy=remedy)
    if not model.startswith(maker.models):
        remedy = f"use a robot of {maker.name}, or the formats ros and ft_calib"
        raise SetupError(f"{model!r} is no robot of {maker.name}", file=setup.path, field="robot.model", remedy=remedy)
    if with_makers_flange(model) == model:
        return here
    own, its = built_in_robot(model), built_in_robot(with_makers_flange(model))
    back = its.flange_rotation.T
    return back @ own.flange_rotation, back @ (own.flange_translation - its.flange_translation)


def _said(setup: Setup, section: str) -> dict[str, object]:
    """Entries of one section in the text of a setup; {} for a setup in memory."""
    return dict(tomllib.loads(setup.source).get(section, {})) if setup.source else {}
