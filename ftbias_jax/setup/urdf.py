"""URDF files: links and the joints between them (wiki.ros.org/urdf/XML), and what a setup takes from them.

The reader is strict: the standard library's parser, no document type, no entities, and every number finite. A setup
takes the arm between two links as screws, and a link's inertia.
"""

import os
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple
from xml.parsers import expat

import numpy as np

from ftbias_jax.errors import SetupError
from ftbias_jax.setup.bodies import RigidBody
from ftbias_jax.setup.fields import nearest, read_file, read_only
from ftbias_jax.setup.robots import Pose, pose_at, prismatic_screw, revolute_screw
from ftbias_jax.setup.types import RobotSetup, SensorSetup, ToolSetup, inertia_matrix
from ftbias_jax.types import Array

MAX_BYTES = 4 << 20
MAX_DEPTH = 32  # of nested elements; a URDF needs six
TURNING, SLIDING, FIXED = ("revolute", "continuous"), ("prismatic",), ("fixed",)


class Joint(NamedTuple):
    """Joint that attaches a link to its parent."""

    name: str
    kind: str
    parent: str
    origin: Pose
    """Joint frame in the parent's."""
    axis: Array
    """(3,) unit, joint frame."""
    mimic: str
    """The joint it follows, or ""."""
    lower: float = -np.inf
    """rad (m), end of the joint's travel."""
    upper: float = np.inf
    """rad (m)."""
    velocity: float = np.inf
    """rad/s (m/s), largest speed."""


class Urdf(NamedTuple):
    """Joints and links of a URDF."""

    file: str
    joints: Mapping[str, Joint]
    """Child link -> the joint that attaches it."""
    links: Mapping[str, ET.Element]

    def error(self, field: str, message: str, remedy: str) -> SetupError:
        """The error to raise about this file."""
        return SetupError(message, file=self.file, field=field, remedy=remedy)


def load_urdf(path: str | os.PathLike[str]) -> Urdf:
    """Read a URDF file.

    Raises:
        SetupError: it cannot be read, is larger than MAX_BYTES, is no URDF, or contradicts itself.
    """
    file = os.fspath(path)
    content = read_file(file, MAX_BYTES, "give the path of a URDF", "give a URDF, not a mesh")
    root = parse_xml(content, file, "a URDF", MAX_DEPTH)
    if root.tag != "robot":
        raise SetupError(f"is no URDF: it is a <{root.tag}>", file=file, remedy="give a file with a <robot>")
    if any(element.tag.startswith("{http://") and "xacro" in element.tag for element in root):
        raise SetupError("has macros", file=file, remedy="expand it: xacro arm.urdf.xacro > arm.urdf")
    links = {link.get("name", ""): link for link in root.findall("link")}
    urdf = Urdf(file, {}, links)
    return urdf._replace(joints=_joints(root, urdf))


def parse_xml(content: bytes, file: str, kind: str, most: int) -> ET.Element:
    """Return the root element; a first pass refuses document types, which could grow, and too deep nesting.

    Args:
        content: of the file.
        file: its name, for messages.
        kind: what the file should be, for messages.
        most: maximum depth of nested elements.

    Raises:
        SetupError: it is no XML, or refused.
    """
    depth = 0

    def refuse(*_: object) -> None:
        raise SetupError("has a document type, which may define entities", file=file, remedy="remove the <!DOCTYPE>")

    def enter(*_: object) -> None:
        nonlocal depth
        depth += 1
        if depth > most:
            raise SetupError(f"nests more than {most} elements", file=file, remedy=f"give {kind}")

    def leave(_: object) -> None:
        nonlocal depth
        depth -= 1

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler, parser.StartElementHandler, parser.EndElementHandler = refuse, enter, leave
    try:
        parser.Parse(content, True)
        return ET.fromstring(content)
    except (expat.ExpatError, ET.ParseError, ValueError, LookupError) as error:  # the last two: odd encodings
        raise SetupError(f"is not valid XML: {error}", file=file, remedy=f"give {kind}") from error


def _joints(root: ET.Element, urdf: Urdf) -> dict[str, Joint]:
    joints: dict[str, Joint] = {}
    for element in root.findall("joint"):
        name = element.get("name", "")
        field = f"joint {name!r}"
        parent, child = (_attribute(element.find(tag), "link") for tag in ("parent", "child"))
        for link in (parent, child):
            if link not in urdf.links:
                raise urdf.error(field, f"joins the link {link!r}, which is not there", nearest(link, urdf.links))
        if child in joints:
            remedy = "a serial arm has no loops: give every link one parent"
            raise urdf.error(field, f"is the second that the link {child!r} hangs on", remedy)
        axis = _numbers(element.find("axis"), "xyz", (1.0, 0.0, 0.0), urdf, field)
        length = np.linalg.norm(axis)
        if not 1e-6 < length < 1e6 and element.get("type") not in FIXED:
            raise urdf.error(field, f"has an axis of length {length:g}", "scale it to length 1")
        unit = axis / length if length else axis
        mimic = _attribute(element.find("mimic"), "joint")
        kind, origin = element.get("type", ""), _origin(element, urdf, field)
        joints[child] = Joint(name, kind, parent, origin, unit, mimic, *_limits(element))
    return joints


def _limits(element: ET.Element) -> tuple[float, float, float]:
    """Ends of a joint's travel and its largest speed; infinite where the file does not state them."""
    limit = element.find("limit")
    if limit is None:
        return -np.inf, np.inf, np.inf
    lower, upper, speed = (_number(limit.get(name)) for name in ("lower", "upper", "velocity"))
    if element.get("type") == "continuous" or not lower < upper:  # two zeros are written for "not known"
        lower, upper = -np.inf, np.inf
    return lower, upper, speed if speed > 0 else np.inf


def _number(text: str | None) -> float:
    """Number of an optional attribute; NaN if it is not a number."""
    try:
        return float(text or 0)
    except ValueError:
        return np.nan


def _origin(element: ET.Element, urdf: Urdf, field: str) -> Pose:
    """The pose in an element's <origin>."""
    zero, origin = (0.0, 0.0, 0.0), element.find("origin")
    return pose_at(*(_numbers(origin, name, zero, urdf, field) for name in ("xyz", "rpy")))


def _attribute(element: ET.Element | None, name: str) -> str:
    return "" if element is None else element.get(name, "")


def _numbers(element: ET.Element | None, name: str, default: tuple[float, ...], urdf: Urdf, field: str) -> Array:
    """Numbers of an attribute, as many as the default has; NaN as default = the attribute is required.

    Raises:
        SetupError: they are not that many, or not finite.
    """
    if element is None:
        return np.array(default)
    text = element.get(name)
    try:
        numbers = np.array(default if text is None else [float(word) for word in text.split()])
    except ValueError:
        numbers = np.array([np.nan])
    if len(numbers) != len(default) or not np.isfinite(numbers).all() or np.abs(numbers).max() > 1e9:
        shown = repr((text or "")[:40])
        raise urdf.error(field, f"<{element.tag} {name}={shown}>", f"give {len(default)} finite numbers")
    return numbers


def urdf_robot(urdf: Urdf, base_link: str, tip_link: str, gravity: Array) -> RobotSetup:
    """Serial arm between two links, whose frames are base frame and flange; base "" = the link without a parent.

    Raises:
        SetupError: a link is not there, is not attached to the base, or a joint of the chain cannot be modelled.
    """
    base_link = base_link or _root(urdf)
    pose, screws, moving = pose_at(), list[Array](), list[Joint]()
    for joint in _chain(urdf, base_link, tip_link):
        pose = pose.then(joint.origin)
        if joint.kind in FIXED:
            continue
        field = f"joint {joint.name!r}"
        if joint.mimic:
            remedy = "choose a tip_link before it"
            raise urdf.error(field, f"follows the joint {joint.mimic!r}, which no serial arm does", remedy)
        if joint.kind not in TURNING + SLIDING:
            known = ", ".join(TURNING + SLIDING + FIXED)
            raise urdf.error(field, f"has the type {joint.kind!r}", f"the chain may have {known}")
        axis = pose.rotation @ joint.axis
        screws.append(prismatic_screw(axis) if joint.kind in SLIDING else revolute_screw(axis, pose.translation))
        moving.append(joint)
    if not screws:
        remedy = "choose links with an arm between them"
        raise urdf.error("tip_link", f"no joint moves between {base_link!r} and {tip_link!r}", remedy)
    return RobotSetup(
        screws=read_only(np.stack(screws)),
        joint_names=tuple(joint.name for joint in moving),
        flange_translation=read_only(pose.translation),
        flange_rotation=read_only(pose.rotation),
        gravity=gravity,
        position_limits=read_only(np.array([(joint.lower, joint.upper) for joint in moving])),
        velocity_limits=read_only(np.array([joint.velocity for joint in moving])),
        urdf_links=(base_link, tip_link),
    )


def urdf_tool(urdf: Urdf, tip_link: str, link: str, sensor: SensorSetup) -> ToolSetup:
    """Mass and inertia of one link that is fixed to the tip, the flange, in the frame of the sensor.

    Raises:
        SetupError: the link is not there, moves relative to the tip, or has no mass.
    """
    field, pose = f"link {link!r}", fixed_pose(urdf, tip_link, link)
    inertial = urdf.links[link].find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    if inertial is None or mass is None:
        raise urdf.error(field, "has no mass", "give tool.mass, center_of_mass and inertia")
    (kilograms,) = _numbers(mass, "value", (np.nan,), urdf, field)
    if kilograms <= 0:
        raise urdf.error(field, f"has the mass {kilograms:g} kg", "give tool.mass, center_of_mass and inertia")
    pose = pose.then(_origin(inertial, urdf, field))
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    moments = [_numbers(inertial.find("inertia"), name, (0.0,), urdf, field) for name in names]
    inertia = pose.rotation @ inertia_matrix(np.concatenate(moments)) @ pose.rotation.T
    body = RigidBody(kilograms, pose.translation, inertia).seen_from(sensor.rotation, sensor.translation)
    return replace(body.as_tool(), urdf_link=link)


def fixed_pose(urdf: Urdf, tip_link: str, link: str) -> Pose:
    """Pose, in the frame of the tip, of a link that is fixed to the tip.

    Raises:
        SetupError: one of the links is not there, or they move relative to each other.
    """
    pose = pose_at()
    for joint in _chain(urdf, tip_link, link):
        if joint.kind not in FIXED:
            message = f"moves against {tip_link!r} by the joint {joint.name!r}"
            raise urdf.error(f"link {link!r}", message, "give tool.mass, center_of_mass and inertia")
        pose = pose.then(joint.origin)
    return pose


def _chain(urdf: Urdf, base_link: str, tip_link: str) -> list[Joint]:
    """The joints from the base to the tip."""
    for link in (base_link, tip_link):
        if link not in urdf.links:
            raise urdf.error(f"link {link!r}", "is not there", nearest(link, urdf.links))
    chain: list[Joint] = []
    link = tip_link
    while link != base_link:
        joint = urdf.joints.get(link)
        if joint is None or len(chain) > len(urdf.joints):  # the second: joints that form a loop
            remedy = f"known links: {', '.join(list(urdf.links)[:40])}"
            raise urdf.error(f"link {tip_link!r}", f"does not hang on {base_link!r}", remedy)
        chain.append(joint)
        link = joint.parent
    return chain[::-1]


def _root(urdf: Urdf) -> str:
    roots = [link for link in urdf.links if link not in urdf.joints]
    if len(roots) != 1:
        raise urdf.error("base_link", f"{len(roots)} links hang on no joint", "name base_link in the setup")
    return roots[0]
