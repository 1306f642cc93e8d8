"""Flexibility and drag of the tool in an MJCF: a body with sprung joints of its own, and dampers."""

from collections.abc import Mapping, Sequence
from functools import reduce
from typing import Any

import numpy as np

from ftbias_jax.setup.bodies import RigidBody, joined
from ftbias_jax.setup.mjcf import Mjcf, distal_body
from ftbias_jax.setup.rotations import quaternions_of
from ftbias_jax.simulators.mended import Physics
from ftbias_jax.simulators.xml_text import Texts, numbers
from ftbias_jax.types import Array

FROM_GEOMS = "the compiler's inertiafromgeom is true: MuJoCo takes all inertia from geoms"
LEAST_SHARE, MOST_SHARE = 1e-3, 0.95
"""Share of the tool on springs: less is neglected as rigid, and some of the tool must remain rigid."""
FAR = 1e3
"""m, length of a damper, such that its direction changes by a thousandth for each metre that the arm moves."""
FULL = (np.array([0, 1, 2, 0, 0, 1]), np.array([0, 1, 2, 1, 2, 2]))
"""Rows and columns of MuJoCo's fullinertia: xx yy zz xy xz yz."""
JOINT = 'armature="0" frictionloss="0" limited="false" ref="0" springref="0"'
"""Attributes of a joint that override the defaults of the file."""


def on_springs(texts: Texts, physics: Physics, bodies: dict[int, RigidBody]) -> tuple[str, dict[int, RigidBody]]:
    """Put a share of the tool on springs; returns why it cannot be done, or "", and the changed bodies of the tool.

    The sprung body is the whole tool scaled to the largest share S of any direction, with a slide or hinge for each
    direction. For a direction with another share s, a stiffness of k = S^2 M W^2 / s gives the same response in slow
    motion, and exactly the same at S = s. ``bodies``, number -> body in the site's frame, are those changed before.
    """
    values, scene = physics.flexibility, texts.scene
    if values is None or not np.isfinite(values["frequency"]) or values["share"].max() < LEAST_SHARE:
        return "", bodies
    if texts.inertia_from_geoms:
        return FROM_GEOMS, bodies
    if values["sagging"] < 0.5:
        return "its springs are balanced against its weight, and those of joints are not", bodies
    parts = {body: bodies.get(body) or distal_body(scene, [body]) for body in rigid_bodies(scene)}
    rigid = {body: part for body, part in parts.items() if part is not None}
    carrier = texts.body(scene.body)
    if not rigid or carrier is None or any(texts.body(body) is None for body in rigid):
        return "a body of the tool has no name in the files, or none has a mass", bodies
    share = min(float(values["share"].max()), MOST_SHARE)
    tool = reduce(joined, rigid.values()).seen_from(physics.sensor_nominal, physics.sensor_position)
    document, element = carrier
    joints = _joints(values, share, tool)
    document.insert(element, _swinging(scene, physics, RigidBody(share * tool.mass, *tool[1:]), share, joints))
    _lengthen_keys(texts, len(joints))
    return "", {i: RigidBody((1 - share) * x.mass, x.center, (1 - share) * x.inertia) for i, x in rigid.items()}


def rigid_bodies(scene: Mjcf) -> list[int]:
    """Bodies distal of the sensor that no joint moves relative to it, the sensor's own first."""
    fixed = [scene.body]
    for body in scene.distal_bodies()[1:]:
        if scene.model.body_jntnum[body] == 0 and int(scene.model.body_parentid[body]) in fixed:
            fixed.append(body)
    return fixed


def _joints(values: Mapping[str, Array], share: float, tool: RigidBody) -> list[str]:
    """MJCF of sprung slides along and hinges about the sensor's axes."""
    arm = tool.center
    turning = tool.inertia + tool.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    inertia = np.concatenate([np.full(3, tool.mass), np.diag(turning)])
    found = []
    for k in np.flatnonzero(values["share"] >= LEAST_SHARE):
        sags = values["sagging"] * values["share"][k] / (2 * np.pi * values["frequency"]) ** 2
        stiffness = share**2 * inertia[k] / sags
        damping = 2 * values["damping_ratio"] * np.sqrt(stiffness * share * inertia[k])
        kind, axis = ("slide", "hinge")[k // 3], numbers(np.eye(3)[k % 3])
        of_spring = f'stiffness="{numbers([stiffness])}" damping="{numbers([damping])}"'
        found.append(f'<joint name="ftbias_{kind}_{"xyz"[k % 3]}" type="{kind}" axis="{axis}" {of_spring} {JOINT}/>')
    return found


def _swinging(scene: Mjcf, physics: Physics, part: RigidBody, share: float, joints: Sequence[str]) -> str:
    """MJCF of the sprung body, whose frame is that of the sensor."""
    axes = axes_of(scene.model.site_quat[scene.site])
    at = numbers(scene.model.site_pos[scene.site] + axes @ physics.sensor_position)
    quat = numbers(quaternions_of((axes @ physics.sensor_nominal)[None])[0])
    inertia = numbers(share * part.inertia[FULL])
    inertial = f'<inertial pos="{numbers(part.center)}" mass="{numbers([part.mass])}" fullinertia="{inertia}"/>'
    lines = "".join(f"\n  {line}" for line in (*joints, inertial))
    return f'<body name="ftbias_on_springs" pos="{at}" quat="{quat}">{lines}\n</body>'


def _lengthen_keys(texts: Texts, count: int) -> None:
    """Insert zeros for the new joints into the states of keyframes, after the joints of the sensor's body."""
    model = texts.scene.model
    later = np.flatnonzero(model.jnt_bodyid > texts.scene.body)
    places = {"qpos": (model.jnt_qposadr, model.nq), "qvel": (model.jnt_dofadr, model.nv)}
    for document, key in texts.all("key"):
        for name, (addresses, end) in places.items():
            if stated := document.elements[key].attributes.get(name, "").split():
                first = int(addresses[later[0]]) if len(later) else end
                document.set(key, name, " ".join([*stated[:first], *["0"] * count, *stated[first:]]))


def mend_drag(texts: Texts, physics: Physics, drags: Sequence[Mapping[str, Any]]) -> str:
    """Add three dampers to distant points for each drag force; returns why it cannot be done, or ""."""
    scene, world, tool = texts.scene, texts.find("worldbody"), texts.body(texts.scene.body)
    if not drags:
        return ""
    if world is None or tool is None:
        return "the bodies at its ends are not in the files"
    data = scene.in_reference_pose()
    lines = list[str]()
    for i, drag in enumerate(drags, 1):
        point = in_world(data, scene, physics, np.asarray(drag["point"], float))
        near = f"ftbias_drag_{i}"
        tool[0].insert(tool[1], f'<site name="{near}" pos="{in_body(data, scene.body, point)}" group="4"/>')
        damping = numbers(np.ravel(drag["coefficients"]))
        for axis, far in zip("xyz", point + FAR * np.eye(3), strict=True):
            world[0].insert(world[1], f'<site name="{near}{axis}" pos="{numbers(far)}" group="4"/>')
            ends = f'<site site="{near}"/><site site="{near}{axis}"/>'
            lines.append(f'<spatial name="{near}{axis}" damping="{damping}" rgba="0 0 0 0">{ends}</spatial>')
    texts.documents[0].insert(0, "\n  ".join(["<tendon>", *lines]) + "\n</tendon>")
    if not texts.all("statistic"):  # otherwise the dampers would set the size of the view
        stat = scene.model.stat
        drawn = f'center="{numbers(stat.center)}" extent="{numbers([stat.extent])}"'
        texts.documents[0].insert(0, f"<statistic {drawn}/>")
    return ""


def in_world(data: Any, scene: Mjcf, physics: Physics, point: Array) -> Array:
    """Point (3,) m of the nominal sensor frame, in the world frame."""
    at_site = physics.sensor_position + physics.sensor_nominal @ point
    return data.site_xpos[scene.site] + data.site_xmat[scene.site].reshape(3, 3) @ at_site


def in_body(data: Any, body: int, world: Array) -> str:
    """Point (3,) m of the world frame, in a body's frame, as text of an attribute."""
    return numbers(data.xmat[body].reshape(3, 3).T @ (world - data.xpos[body]))


def axes_of(quaternion: Array) -> Array:
    """(3, 3) rotation matrix of a quaternion w, x, y, z."""
    import mujoco

    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, quaternion)
    return axes.reshape(3, 3)
