"""Correct an MJCF: the user's own text with other values of tool, mounting, gravity and joints.

One body of the tool gets the mass and inertia that its other bodies lack, a part of the tool gets springs, the site is
rotated, ``ref`` of a joint takes its encoder offset, a cable is a tendon with slack, and drag is dampers. Included
files are changed in copies.
"""

import numpy as np

from ftbias_jax.model.effects.terms.parse import TERM
from ftbias_jax.setup.bodies import RigidBody, joined
from ftbias_jax.setup.mjcf import Mjcf, distal_body, mjcf_robot
from ftbias_jax.setup.rotations import quaternions_of
from ftbias_jax.setup.types import Setup
from ftbias_jax.simulators import mend_springs, mended
from ftbias_jax.simulators.xml_text import Document, Texts, numbers

ORIENTATIONS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")


def mend_mjcf(setup: Setup, scene: Mjcf, output: str) -> mended.Mended:
    """Text of a scene, corrected to the robot and tool of a setup whose effects are the findings of a diagnosis.

    Paths of other files in the scene are made relative to the location of the corrected scene, ``output``.

    Raises:
        SetupError: the scene's arm is not the setup's.
    """
    physics = mended.physics_of(setup)
    mended.check_arm(setup, mjcf_robot(scene), scene.file, "--mjcf SCENE.xml")
    texts = Texts(scene, output)
    drags = [section for section in setup.effects.get(TERM, ()) if mended.is_drag(section)]
    missing = mended.not_expressed(mended.without_drag(setup.effects), mended.OF_THE_ROBOT)
    of_tool, bodies = _mend_tool(texts, physics)
    of_springs, bodies = mend_springs.on_springs(texts, physics, bodies)
    for body, part in bodies.items():
        place = texts.body(body)
        assert place is not None  # bodies without an element are never chosen
        _write_inertial(scene, *place, body, part)
    of_site = _mend_site(texts, physics)
    mounts = [name for name in ("mount_translation", "mount_rotation") if name in setup.effects] or ["mount_rotation"]
    for name, done in {
        "tool": of_tool,
        "tool_flexibility": of_springs,
        **dict.fromkeys(mounts, of_site),
        "gravity_tilt": _mend_gravity(texts, physics),
        "encoder_offset": _mend_joints(texts, physics),
        "cable": _mend_cable(texts, physics),
        TERM: mend_springs.mend_drag(texts, physics, drags),
    }.items():
        missing += [{"effect": name, "parameters": setup.effects.get(name, {}), "why": done}] if done else []
    return mended.Mended(texts.written(), missing)


def _mend_tool(texts: Texts, physics: mended.Physics) -> tuple[str, dict[int, RigidBody]]:
    """Reason why it cannot be done ("" = none), and the body to change, with its new inertia, in the site's frame."""
    scene, wanted = texts.scene, physics.tool
    wanted = wanted.seen_from(physics.sensor_nominal.T, -physics.sensor_nominal.T @ physics.sensor_position)
    bodies = scene.distal_bodies()
    whole = distal_body(scene, bodies)
    if whole is not None and mended.same_body(whole, wanted):
        return "", {}
    if texts.inertia_from_geoms:
        return mend_springs.FROM_GEOMS, {}
    for body in sorted(mend_springs.rigid_bodies(scene), key=lambda body: -float(scene.model.body_mass[body])):
        rest = distal_body(scene, [other for other in bodies if other != body])
        left = wanted if rest is None else joined(wanted, rest, -1.0)
        if texts.body(body) is not None and left.mass > 0 and _is_physical(left):
            return "", {body: left}
    return "no body of the tool can take the difference: what is left of it would be no body", {}


def _is_physical(body: RigidBody) -> bool:
    moments = np.linalg.eigvalsh(body.inertia)
    return bool(moments[0] > 0 and moments[2] <= moments[0] + moments[1])


def _write_inertial(scene: Mjcf, document: Document, element: int, body: int, in_site: RigidBody) -> None:
    """Write the <inertial> of one body, changing only the attributes that differ."""
    data, model = scene.in_reference_pose(), scene.model
    to_world = data.site_xmat[scene.site].reshape(3, 3)
    rotation = to_world.T @ data.xmat[body].reshape(3, 3)  # the body's axes in the site's frame
    position = to_world.T @ (data.xpos[body] - data.site_xpos[scene.site])
    new = in_site.seen_from(rotation, position)
    axes = mend_springs.axes_of(model.body_iquat[body])
    old = RigidBody(
        float(model.body_mass[body]), model.body_ipos[body], axes @ np.diag(model.body_inertia[body]) @ axes.T
    )
    values = {
        "pos": numbers(new.center),
        "mass": numbers([new.mass]),
        "fullinertia": numbers(new.inertia[mend_springs.FULL]),
    }
    there = document.children(element, "inertial")
    if not there:
        words = " ".join(f'{name}="{value}"' for name, value in values.items())
        document.insert(element, f"<inertial {words}/>")
        return
    if abs(new.mass - old.mass) > mended.SAME * old.mass:
        document.set(there[0], "mass", values["mass"])
    if np.abs(new.center - old.center).max() > mended.SAME:
        document.set(there[0], "pos", values["pos"])
    if np.abs(new.inertia - old.inertia).max() > 1e-7 * np.abs(old.inertia).max():
        for name in (*ORIENTATIONS, "diaginertia"):
            document.set(there[0], name, None)
        document.set(there[0], "fullinertia", values["fullinertia"])


def _mend_site(texts: Texts, physics: mended.Physics) -> str:
    """Rotate and move the site of the sensor; returns why it cannot be done, or ""."""
    turn, shift = physics.sensor_rotation, physics.sensor_position
    if np.allclose(turn, np.eye(3), atol=mended.SAME) and np.allclose(shift, 0, atol=mended.SAME):
        return ""
    model, site = texts.scene.model, texts.scene.site
    place = texts.find("site", name=texts.site_name)
    if place is None or place[0].elements[place[0].elements[place[1]].parent].tag != "body":
        return "the sensor's site does not stand right in a <body> of the files"
    document, element = place
    axes = mend_springs.axes_of(model.site_quat[site])
    if np.abs(shift).max() > mended.SAME:
        document.set(element, "pos", numbers(model.site_pos[site] + axes @ shift))
    for name in ORIENTATIONS:
        document.set(element, name, None)
    document.set(element, "quat", numbers(quaternions_of((axes @ turn)[None])[0]))
    return ""


def _mend_gravity(texts: Texts, physics: mended.Physics) -> str:
    scene = texts.scene
    gravity = scene.in_reference_pose().xmat[scene.base].reshape(3, 3) @ physics.gravity
    if np.allclose(gravity, scene.model.opt.gravity, rtol=0, atol=1e-7):
        return ""
    options = texts.all("option")
    stated = [(d, i) for d, i in options if "gravity" in d.elements[i].attributes] or options[:1]
    for document, element in stated:
        document.set(element, "gravity", numbers(gravity))
    if not stated:
        texts.documents[0].insert(0, f'<option gravity="{numbers(gravity)}"/>')
    return ""


def _mend_joints(texts: Texts, physics: mended.Physics) -> str:
    import mujoco

    model, missing = texts.scene.model, list[str]()
    degrees = all(d.elements[i].attributes.get("angle") != "radian" for d, i in texts.all("compiler"))
    for joint, offset in zip(texts.scene.joints, physics.offsets, strict=True):
        if offset == 0:
            continue
        name = model.joint(joint).name
        place = texts.find("joint", name=name) if name else None
        if place is None:
            missing.append(name or f"number {joint}")
            continue
        hinge = model.jnt_type[joint] == int(mujoco.mjtJoint.mjJNT_HINGE)
        ref = model.qpos0[model.jnt_qposadr[joint]] + offset
        place[0].set(place[1], "ref", numbers([np.degrees(ref) if degrees and hinge else ref]))
    return f"the files have no joint {', '.join(missing)}" if missing else ""


def _mend_cable(texts: Texts, physics: mended.Physics) -> str:
    """Add a tendon between two new sites, which pulls with its stiffness beyond its rest length and never pushes."""
    cable, scene = physics.cable, texts.scene
    if cable is None or cable["stiffness"] == 0:
        return ""
    link = round(float(cable["link"]))
    carrier = int(scene.model.jnt_bodyid[scene.joints[link - 1]]) if link else scene.base
    worlds = texts.find("worldbody")
    near, far = texts.body(scene.body), (worlds if carrier == 0 else texts.body(carrier))
    if near is None or far is None:
        return "the bodies at its ends are not in the files"
    data = scene.in_reference_pose()
    to_world = data.xmat[scene.base].reshape(3, 3)
    ends = {
        "ftbias_cable_near": (*near, scene.body, mend_springs.in_world(data, scene, physics, cable["attachment"])),
        "ftbias_cable_far": (*far, carrier, data.xpos[scene.base] + to_world @ cable["anchor"]),
    }
    for name, (document, element, body, point) in ends.items():
        document.insert(element, f'<site name="{name}" pos="{mend_springs.in_body(data, body, point)}" group="4"/>')
    stiffness, length = numbers([cable["stiffness"]]), numbers([cable["rest_length"]])
    sites = "".join(f'\n    <site site="{name}"/>' for name in ends)
    tendon = f'<spatial name="ftbias_cable" stiffness="{stiffness}" springlength="0 {length}">{sites}\n  </spatial>'
    texts.documents[0].insert(0, f"<tendon>\n  {tendon}\n</tendon>")
    return ""
