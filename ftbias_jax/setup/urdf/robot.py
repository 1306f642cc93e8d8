"""What a setup takes from a URDF: the arm between two links as screws, and a link's inertia."""

from __future__ import annotations

import numpy as np

from ftbias_jax.setup.chains import Pose, pose_at, prismatic_screw, revolute_screw
from ftbias_jax.setup.fields import nearest, read_only
from ftbias_jax.setup.types import RobotSetup, ToolSetup, inertia_matrix
from ftbias_jax.setup.urdf.read import FIXED, SLIDING, TURNING, Joint, Urdf, numbers_of, origin_of
from ftbias_jax.types import Array


def urdf_robot(urdf: Urdf, base_link: str, tip_link: str, gravity: Array) -> RobotSetup:
    """The serial arm between two links, whose frames are base frame and flange; base "" = that hangs on no joint.

    Raises:
        SetupError: a link is not there, does not hang on the base, or a joint of the chain cannot be modelled.
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
    )


def urdf_tool(urdf: Urdf, tip_link: str, link: str, sensor: Pose) -> ToolSetup:
    """The mass and inertia of one link that is fixed to the tip, the flange, in the frame of the sensor.

    Raises:
        SetupError: the link is not there, moves against the tip, or has no mass.
    """
    pose = pose_at()
    for joint in _chain(urdf, tip_link, link):
        if joint.kind not in FIXED:
            message = f"moves against {tip_link!r} by the joint {joint.name!r}"
            raise urdf.error(f"link {link!r}", message, "give tool.mass, center_of_mass and inertia")
        pose = pose.then(joint.origin)
    field = f"link {link!r}"
    inertial = urdf.links[link].find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    if inertial is None or mass is None:
        raise urdf.error(field, "has no mass", "give tool.mass, center_of_mass and inertia")
    (kilograms,) = numbers_of(mass, "value", (np.nan,), urdf, field)
    if kilograms <= 0:
        raise urdf.error(field, f"has the mass {kilograms:g} kg", "give tool.mass, center_of_mass and inertia")
    pose = pose.then(origin_of(inertial, urdf, field))
    center = sensor.rotation.T @ (pose.translation - sensor.translation)
    turn = sensor.rotation.T @ pose.rotation
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    moments = [numbers_of(inertial.find("inertia"), name, (0.0,), urdf, field) for name in names]
    inertia = (turn @ inertia_matrix(np.concatenate(moments)) @ turn.T)[np.triu_indices(3)]
    return ToolSetup(float(kilograms), read_only(center), read_only(inertia))


def _chain(urdf: Urdf, base_link: str, tip_link: str) -> list[Joint]:
    """The joints from the base to the tip."""
    for link in (base_link, tip_link):
        if link not in urdf.links:
            raise urdf.error(f"link {link!r}", "is not there", nearest(link, urdf.links))
    chain: list[Joint] = []
    link = tip_link
    while link != base_link:
        joint = urdf.joints.get(link)
        if joint is None or len(chain) > len(urdf.joints):  # the second: joints that bite their tail
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
