"""Robot and tool of a setup from MJCF files, which MuJoCo itself compiles.

A setup takes the arm up to the sensor's site, as screws, and everything distal of the sensor, as one rigid body: the
site's own body and all bodies attached to it. MuJoCo's force sensors act between the same two.
"""

import os
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.errors import SetupError
from ftbias_jax.setup.bodies import RigidBody, joined
from ftbias_jax.setup.fields import nearest, read_file, read_only
from ftbias_jax.setup.robots import prismatic_screw, revolute_screw
from ftbias_jax.setup.types import RobotSetup, SensorSetup, ToolSetup, unknown_tool
from ftbias_jax.setup.urdf import parse_xml
from ftbias_jax.types import Array

MAX_BYTES = 16 << 20
MAX_DEPTH = 128  # of nested elements: every body nests in its parent
VIEW = "see what MuJoCo's viewer says: python -m mujoco.viewer --mjcf FILE"


class Mjcf(NamedTuple):
    """A compiled MJCF, and the site where the sensor is."""

    file: str
    model: Any
    """``mujoco.MjModel``, without purely visual geometry."""
    site: int
    """Number of the sensor's site."""
    base: int
    """Body whose frame is the base frame; 0 = the world."""
    joints: tuple[int, ...]
    """Numbers of the arm's joints, from the base to the sensor."""

    def error(self, field: str, message: str, remedy: str) -> SetupError:
        """The error to raise about this file."""
        return SetupError(message, file=self.file, field=field, remedy=remedy)

    @property
    def body(self) -> int:
        """The body that the sensor's site is on."""
        return int(self.model.site_bodyid[self.site])

    def in_reference_pose(self) -> Any:
        """``mujoco.MjData`` with the arm's joints at zero and all others as the file has them."""
        import mujoco

        data = mujoco.MjData(self.model)
        data.qpos[self.model.jnt_qposadr[list(self.joints)]] = 0.0
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        return data

    def distal_bodies(self) -> list[int]:
        """The site's own body and all bodies attached to it, parents first."""
        found = [self.body]
        for body in range(self.body + 1, self.model.nbody):
            if int(self.model.body_parentid[body]) in found:
                found.append(body)
        return found


def load_mjcf(path: str | os.PathLike[str], site: str = "", base: str = "") -> Mjcf:
    """Compile an MJCF with MuJoCo, with the files that it includes and its meshes.

    Args:
        path: of the file.
        site: of the sensor; "" = the one site of the file's force and torque sensors.
        base: body whose frame is the base frame; "" = the world.

    Raises:
        SetupError: MuJoCo is not installed or cannot compile it, or site or base are not there.
    """
    file = os.fspath(path)
    content = read_file(file, MAX_BYTES, "give the path of an MJCF", "give an MJCF, not a mesh")
    root = parse_xml(content, file, "an MJCF", MAX_DEPTH)
    if root.tag != "mujoco":
        raise SetupError(f"is no MJCF: it is a <{root.tag}>", file=file, remedy="give a file with a <mujoco>")
    try:
        import mujoco
    except ImportError as error:
        raise SetupError("needs MuJoCo", file=file, remedy="pip install 'ftbias-jax[mujoco]'") from error
    try:
        spec = mujoco.MjSpec.from_file(file)
        spec.compiler.discardvisual = True  # large visual meshes take seconds
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise SetupError(f"MuJoCo cannot compile it: {error}", file=file, remedy=VIEW) from error
    found = Mjcf(file, model, -1, 0, ())
    found = found._replace(site=_site(found, site), base=_named(found, "body", base, "base_link") if base else 0)
    return found._replace(joints=_joints(found))


def _site(mjcf: Mjcf, name: str) -> int:
    import mujoco

    if name:
        return _named(mjcf, "site", name, "site")
    model = mjcf.model
    kinds = [int(kind) for kind in (mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_TORQUE)]
    sites = sorted(set(model.sensor_objid[np.isin(model.sensor_type, kinds)].tolist()))
    if len(sites) == 1:
        return int(sites[0])
    known = [model.site(i).name for i in sites or range(model.nsite)]
    message = f"{len(sites)} sites have force or torque sensors"
    raise mjcf.error("site", message, f"name the sensor's site; there are: {', '.join(known[:20]) or 'none'}")


def _named(mjcf: Mjcf, kind: str, name: str, field: str) -> int:
    """The number of a site or body with a name."""
    try:
        return int(getattr(mjcf.model, kind)(name).id)
    except KeyError as error:
        count = getattr(mjcf.model, f"n{kind}")
        known = [getattr(mjcf.model, kind)(i).name for i in range(count)]
        raise mjcf.error(field, f"there is no {kind} {name!r}", nearest(name, known)) from error


def _joints(mjcf: Mjcf) -> tuple[int, ...]:
    import mujoco

    model, body, joints = mjcf.model, mjcf.body, list[int]()
    while body != mjcf.base:
        if body == 0:
            base = model.body(mjcf.base).name
            raise mjcf.error("base_link", f"the sensor's site does not hang on {base!r}", "name a body that carries it")
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        joints = [*range(first, first + count), *joints]
        body = int(model.body_parentid[body])
    kinds = [int(kind) for kind in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)]
    for joint in joints:
        if model.jnt_type[joint] not in kinds:
            remedy = "a serial arm has hinges and slides: name a body beyond this joint as base_link"
            raise mjcf.error(f"joint {model.joint(joint).name!r}", "is a ball or a free joint", remedy)
    if not joints:
        raise mjcf.error("site", "no joint moves the sensor", "choose a site with an arm before it")
    return tuple(joints)


def mjcf_robot(mjcf: Mjcf, gravity: Array | None = None) -> RobotSetup:
    """The serial arm between base and sensor, whose flange is the sensor's site.

    Args:
        mjcf: the file.
        gravity: (3,) m/s^2, base frame; None = as the file has it.
    """
    import mujoco

    model, data, joints = mjcf.model, mjcf.in_reference_pose(), list(mjcf.joints)
    rotation, origin = data.xmat[mjcf.base].reshape(3, 3), data.xpos[mjcf.base]
    axes, points = data.xaxis[joints] @ rotation, (data.xanchor[joints] - origin) @ rotation
    slides = model.jnt_type[joints] == int(mujoco.mjtJoint.mjJNT_SLIDE)
    triples = zip(slides, axes, points, strict=True)
    screws = [prismatic_screw(axis) if slide else revolute_screw(axis, point) for slide, axis, point in triples]
    limits = np.where(model.jnt_limited[joints, None] > 0, model.jnt_range[joints], (-np.inf, np.inf))
    return RobotSetup(
        screws=read_only(np.stack(screws)),
        joint_names=tuple(model.joint(i).name or f"joint{k}" for k, i in enumerate(joints, 1)),
        flange_translation=read_only(rotation.T @ (data.site_xpos[mjcf.site] - origin)),
        flange_rotation=read_only(rotation.T @ data.site_xmat[mjcf.site].reshape(3, 3)),
        gravity=read_only(rotation.T @ model.opt.gravity) if gravity is None else gravity,
        position_limits=read_only(limits),
    )


def mjcf_tool(mjcf: Mjcf, sensor: SensorSetup | None = None) -> ToolSetup:
    """Return everything distal of the sensor, in the sensor frame, with moving parts posed as in the file.

    The sensor frame is the site's, unless the setup places it beside it. Without any mass the tool is not known.
    """
    whole = distal_body(mjcf, mjcf.distal_bodies())
    if whole is None:
        return unknown_tool()
    return (whole if sensor is None else whole.seen_from(sensor.rotation, sensor.translation)).as_tool()


def distal_body(mjcf: Mjcf, bodies: list[int]) -> RigidBody | None:
    """Combine bodies beyond the sensor into one, in the frame of the site; None if they have no mass."""
    model, data, whole = mjcf.model, mjcf.in_reference_pose(), None
    rotation, position = data.site_xmat[mjcf.site].reshape(3, 3), data.site_xpos[mjcf.site]
    for body in bodies:
        axes = data.ximat[body].reshape(3, 3)
        inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T
        part = RigidBody(float(model.body_mass[body]), data.xipos[body], inertia).seen_from(rotation, position)
        if part.mass > 0:
            whole = part if whole is None else joined(whole, part)
    return whole
