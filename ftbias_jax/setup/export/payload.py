"""The tool as a robot's controller sees it: in the frame of the robot's own tool flange."""

from __future__ import annotations

import tomllib
from typing import NamedTuple

import numpy as np

from ftbias_jax.errors import SetupError
from ftbias_jax.setup.export.options import ExportOptions
from ftbias_jax.setup.recorded import POSE
from ftbias_jax.setup.require import require_tool
from ftbias_jax.setup.robots import built_in_robot
from ftbias_jax.setup.types import SCREWS, Setup
from ftbias_jax.types import Array


class Maker(NamedTuple):
    """Whose flange it is."""

    name: str
    models: tuple[str, ...]
    """Beginnings of the names of built-in robots."""
    flanges: dict[str, str]
    """Built-in robots whose frame is not the maker's flange -> the same arm with the maker's."""
    links: tuple[str, ...]
    """Ends of the names of links of URDFs that are the flange."""


UR = Maker("Universal Robots", ("ur",), {}, ("tool0",))
FRANKA = Maker("Franka", ("panda", "fr3"), {"panda": "panda_link8", "fr3": "fr3_link8"}, ("link8",))


class Payload(NamedTuple):
    """A rigid body at the flange."""

    mass: float
    """kg."""
    center: Array
    """(3,) m, centre of mass in the flange frame."""
    inertia: Array
    """(3, 3) kg m^2 about the centre of mass, axes of the flange."""


def payload_of(setup: Setup, maker: Maker, options: ExportOptions) -> Payload:
    """The tool, and what is between flange and sensor, in the frame of the maker's flange.

    v_flange = R v_sensor turns vectors; a point c of the sensor frame is at R c + p, and the inertia about the centre
    of mass becomes R I R'. Two bodies are joined by the parallel axis theorem.

    Args:
        setup: with the tool in the sensor frame.
        maker: of the robot.
        options: of the export.

    Raises:
        SetupError: the setup does not state the tool, its robot is another maker's, or a transform is not known.
    """
    tool = require_tool(setup).tool
    if not options.frames_as_stated:
        _check_mounting(setup)
    turned, moved = _flange(setup, maker, options)
    sensor = setup.sensor
    rotation, position = turned @ sensor.rotation, turned @ sensor.translation + moved
    xx, xy, xz, yy, yz, zz = tool.inertia
    inertia = rotation @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ rotation.T
    payload = Payload(tool.mass, rotation @ tool.center_of_mass + position, inertia)
    if options.sensor_mass is None:
        return payload
    mass, *center = options.sensor_mass
    return joined(payload, Payload(mass, np.array(center), np.zeros((3, 3))))


def joined(one: Payload, other: Payload) -> Payload:
    """Two bodies as one."""
    mass = one.mass + other.mass
    center = (one.mass * one.center + other.mass * other.center) / mass
    inertia = sum(body.inertia + _of_point(body.mass, body.center - center) for body in (one, other))
    return Payload(mass, center, inertia)


def _of_point(mass: float, place: Array) -> Array:
    return mass * (place @ place * np.eye(3) - np.outer(place, place))


def _check_mounting(setup: Setup) -> None:
    """How the sensor is mounted must be stated, be it zero: a default is no measurement."""
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
        if tip.endswith(maker.links) or options.frames_as_stated:
            return here
        remedy = "if the flange of the setup is that of its controller, say so: --frames-as-stated"
        message = f"the tool flange of {maker.name} is not known in this setup"
        field = "robot.tip_link" if tip else "robot.flange"
        raise SetupError(message, file=setup.path, field=field, remedy=remedy)
    if not model.startswith(maker.models):
        remedy = f"use a robot of {maker.name}, or the formats ros and ft_calib"
        raise SetupError(f"{model!r} is no robot of {maker.name}", file=setup.path, field="robot.model", remedy=remedy)
    if model not in maker.flanges:
        return here
    own, its = built_in_robot(model), built_in_robot(maker.flanges[model])
    back = its.flange_rotation.T
    return back @ own.flange_rotation, back @ (own.flange_translation - its.flange_translation)


def _said(setup: Setup, section: str) -> dict[str, object]:
    """What the text of a setup says in a section; {} of a setup in memory."""
    return dict(tomllib.loads(setup.source).get(section, {})) if setup.source else {}
