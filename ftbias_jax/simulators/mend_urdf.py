"""Correct a URDF: the user's own text with another inertia of the tool's link and other origins of joints."""

from collections.abc import Mapping

import numpy as np

from ftbias_jax.setup.bodies import RigidBody
from ftbias_jax.setup.robots import Pose, pose_at
from ftbias_jax.setup.rotations import rotation_from_rpy, rotation_from_vector, rpy_from_rotation
from ftbias_jax.setup.types import Setup
from ftbias_jax.setup.urdf import SLIDING, Joint, fixed_pose, load_urdf, urdf_robot
from ftbias_jax.simulators.mended import SAME, Mended, Physics, check_arm, not_expressed, physics_of
from ftbias_jax.simulators.xml_text import Document, numbers
from ftbias_jax.types import Array

OF_JOINTS = "encoder_offset"
OF_A_URDF = ("tool_mass", "tool_com", "tool_inertia", OF_JOINTS)
"""Effects that a URDF can express."""


def mend_urdf(setup: Setup, like: str, output: str, link: str = "") -> Mended:
    """Text of a URDF, corrected to the joints and tool of a setup whose effects are the findings of a diagnosis.

    The origin of a joint with an encoder offset is rotated back by the offset (shifted, if the joint is prismatic). One
    link that is fixed to the flange, ``link`` or else the setup's ``tool.from_urdf_link``, gets mass, centre of mass
    and inertia of the whole tool; findings of the joints alone do not need it.

    Raises:
        SetupError: the file is no URDF, its arm is not the setup's, or nothing names the tool's link.
    """
    urdf, link = load_urdf(like), link or setup.tool.urdf_link
    if setup.robot.urdf_links is None:
        raise urdf.error("robot", "the arm of the setup is of no URDF", "state robot.urdf and tip_link in the setup")
    joints_alone = {*setup.effects} & {*OF_A_URDF} == {OF_JOINTS}
    if not link and not joints_alone:
        raise urdf.error(
            "link", "nothing says which link is the tool", "state tool.from_urdf_link, or give --site LINK"
        )
    base, tip = setup.robot.urdf_links
    robot = urdf_robot(urdf, base, tip, setup.robot.gravity)
    check_arm(setup, robot, like, "--urdf ROBOT.urdf")
    physics, document = physics_of(setup), Document(like)
    joints = {joint.name: joint for joint in urdf.joints.values()}
    for name, offset in zip(robot.joint_names, physics.offsets, strict=True):
        if offset:
            _move(document, joints[name], offset)
    if link:
        pose = fixed_pose(urdf, tip, link)
        _write_inertial(document, document.find("link", name=link)[0], _in_link(physics, pose))
    return Mended({output: document.text}, not_expressed(setup.effects, OF_A_URDF))


def _move(document: Document, joint: Joint, offset: float) -> None:
    """Change a joint's origin so that its recorded angle (or travel), too large by ``offset``, gives the true pose."""
    if joint.kind in SLIDING:
        back = pose_at(-offset * joint.axis)
    else:
        back = Pose(np.zeros(3), rotation_from_vector(-offset * joint.axis))
    origin = joint.origin.then(back)
    (element,) = document.find("joint", name=joint.name)
    _write(document, element, "origin", {"xyz": origin.translation, "rpy": rpy_from_rotation(origin.rotation)})


def _in_link(physics: Physics, link: Pose) -> RigidBody:
    """The tool in the frame of its link, which is fixed to the flange."""
    turn = physics.sensor_nominal.T
    return physics.tool.seen_from(turn, -turn @ physics.sensor_position).seen_from(link.rotation, link.translation)


def _write_inertial(document: Document, element: int, body: RigidBody) -> None:
    """Write the inertia of a link, along the axes that its <inertial> has in the file."""
    there = document.children(element, "inertial")
    if not there:
        origin, mass = numbers(body.center), numbers([body.mass])
        words = " ".join(f'{name}="{numbers([x])}"' for name, x in _moments(body.inertia).items())
        inner = f'<origin xyz="{origin}"/>\n  <mass value="{mass}"/>\n  <inertia {words}/>'
        document.insert(element, f"<inertial>\n  {inner}\n</inertial>")
        return
    origins = [document.elements[i].attributes for i in document.children(there[0], "origin")]
    rpy = origins[0].get("rpy", "0 0 0") if origins else "0 0 0"
    axes = rotation_from_rpy(np.array(rpy.split(), float))
    _write(document, there[0], "origin", {"xyz": body.center})
    _write(document, there[0], "mass", {"value": np.array([body.mass])})
    moments = {name: np.array([x]) for name, x in _moments(axes.T @ body.inertia @ axes).items()}
    _write(document, there[0], "inertia", moments, np.abs(body.inertia).max())


def _moments(inertia: Array) -> dict[str, float]:
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    return dict(zip(names, inertia[np.triu_indices(3)].tolist(), strict=True))


def _write(document: Document, parent: int, tag: str, values: Mapping[str, Array], size: float = 1.0) -> None:
    """Write attributes of a child element where they differ by more than the rounding of numbers of ``size``."""
    there = document.children(parent, tag)
    if not there:
        words = " ".join(f'{name}="{numbers(x)}"' for name, x in values.items())
        document.insert(parent, f"<{tag} {words}/>")
        return
    for name, value in values.items():
        stated = document.elements[there[0]].attributes.get(name, " ".join("0" for _ in value))
        if not np.allclose(np.array(stated.split(), float), value, rtol=SAME, atol=SAME * size):
            document.set(there[0], name, numbers(value))
