"""An MJCF mended: the user's own text with other values of tool, mounting, gravity and joints.

A body of the tool gets what the others leave of its mass and inertia, the site is turned, ``ref`` of a joint takes its
encoder's offset, and a cable is a tendon with slack. What stands in included files is changed in copies of these.
"""

from __future__ import annotations

import os

import numpy as np

from ftbias_jax.setup.bodies import RigidBody, joined
from ftbias_jax.setup.mjcf import Mjcf, distal_body, mjcf_robot
from ftbias_jax.setup.rotations import quaternions_of
from ftbias_jax.setup.types import Setup
from ftbias_jax.simulators.mended import (
    OF_THE_ROBOT,
    SAME,
    Mended,
    Physics,
    check_arm,
    not_expressed,
    physics_of,
    same_body,
)
from ftbias_jax.simulators.xml_text import Document, numbers
from ftbias_jax.types import Array

ORIENTATIONS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
FILES = ("file", "fileleft", "fileright", "fileup", "filedown", "filefront", "fileback")
"""Attributes that name a file."""


def mend_mjcf(setup: Setup, scene: Mjcf, output: str) -> Mended:
    """The text of a scene with what a setup says of robot and tool.

    Args:
        setup: its effects are what a diagnosis found; its robot is that of the scene.
        scene: as it is.
        output: where the mended scene will be; files that it refers to are found from there.

    Raises:
        SetupError: its arm is not the setup's.
    """
    physics = physics_of(setup)
    check_arm(setup, mjcf_robot(scene), scene.file, "--mjcf SCENE.xml")
    texts = _Texts(scene, output)
    missing = not_expressed(setup, OF_THE_ROBOT)
    for name, done in {
        "tool": _mend_tool(texts, physics),
        "mount_rotation": _mend_site(texts, physics),
        "gravity_tilt": _mend_gravity(texts, physics),
        "encoder_offset": _mend_joints(texts, physics),
        "cable": _mend_cable(texts, physics),
    }.items():
        missing += [{"effect": name, "parameters": setup.effects.get(name, {}), "why": done}] if done else []
    return Mended(texts.written(), missing)


class _Texts:
    """The documents that a scene is made of."""

    def __init__(self, scene: Mjcf, output: str) -> None:
        self.scene, self.output = scene, output
        self.documents = [Document(scene.file)]
        folder = os.path.dirname(scene.file)
        for document in self.documents:  # grows on the way
            for i in document.find("include"):
                path = os.path.join(folder, document.elements[i].attributes.get("file", ""))
                if path not in {other.file for other in self.documents}:
                    self.documents.append(Document(path))

    def find(self, tag: str, **attributes: str) -> tuple[Document, int] | None:
        """The first element of a tag with these attributes."""
        return next(((d, i) for d in self.documents for i in d.find(tag, **attributes)), None)

    def body(self, body: int) -> tuple[Document, int] | None:
        """The element of a body: by its name, or as what the sensor's site is in."""
        name, site = self.scene.model.body(body).name, self.find("site", name=self.site_name)
        if name or site is None or body != self.scene.body:
            return self.find("body", name=name) if name else None
        return site[0], site[0].elements[site[1]].parent

    @property
    def site_name(self) -> str:
        """Of the sensor."""
        return str(self.scene.model.site(self.scene.site).name)

    def all(self, tag: str) -> list[tuple[Document, int]]:
        """Every element of a tag."""
        return [(document, i) for document in self.documents for i in document.find(tag)]

    def written(self) -> dict[str, str]:
        """Path -> text of the scene and of what it includes and was changed; all with the paths that hold there."""
        main, *others = self.documents
        target, stem = os.path.dirname(self.output), os.path.splitext(os.path.basename(self.output))[0]
        copies = {d.file: f"{stem}_{os.path.basename(d.file)}" for d in others if d.changed}
        here, there = (os.path.realpath(folder or ".") for folder in (os.path.dirname(main.file), target))
        for document in [main, *(d for d in others if d.file in copies)] if here != there or copies else []:
            self._move_files(document, here, there, copies)
        written = {self.output: main.text}
        return written | {os.path.join(target, copies[d.file]): d.text for d in others if d.file in copies}

    def _move_files(self, document: Document, here: str, there: str, copies: dict[str, str]) -> None:
        """Paths in a document, relative to one folder, as they are from another."""
        in_folder = any(
            {"meshdir", "assetdir", "texturedir"} & d.elements[i].attributes.keys() for d, i in self.all("compiler")
        )
        for i, element in enumerate(document.elements):
            names = ("meshdir", "texturedir", "assetdir") if element.tag == "compiler" else FILES
            if element.tag not in ("compiler", "include") and in_folder:
                continue  # found from those folders
            for name in names:
                path = element.attributes.get(name)
                if path is None or os.path.isabs(path):
                    continue
                full = os.path.join(here, path)
                copy = copies.get(os.path.join(os.path.dirname(self.scene.file), path))
                new = copy if element.tag == "include" and copy else os.path.relpath(full, there)
                if new != path:
                    document.set(i, name, new)


def _mend_tool(texts: _Texts, physics: Physics) -> str:
    """Give a body of the tool what makes the whole of it right; what hinders it, or ""."""
    scene, wanted = texts.scene, physics.tool
    wanted = wanted.seen_from(physics.sensor_believed.T, -physics.sensor_believed.T @ physics.sensor_position)
    bodies = scene.distal_bodies()
    whole = distal_body(scene, bodies)
    if whole is not None and same_body(whole, wanted):
        return ""
    if any(d.elements[i].attributes.get("inertiafromgeom") == "true" for d, i in texts.all("compiler")):
        return "the compiler's inertiafromgeom is true: MuJoCo takes all inertia from geoms"
    for body in sorted(_rigid(scene, bodies), key=lambda body: -float(scene.model.body_mass[body])):
        place, rest = texts.body(body), distal_body(scene, [other for other in bodies if other != body])
        left = wanted if rest is None else joined(wanted, rest, -1.0)
        if place is not None and left.mass > 0 and _is_physical(left):
            _write_inertial(scene, *place, body, left)
            return ""
    return "no body of the tool can take the difference: what is left of it would be no body"


def _rigid(scene: Mjcf, bodies: list[int]) -> list[int]:
    """Those of the bodies that no joint moves against the sensor."""
    fixed = [scene.body]
    for body in bodies[1:]:
        if scene.model.body_jntnum[body] == 0 and int(scene.model.body_parentid[body]) in fixed:
            fixed.append(body)
    return fixed


def _is_physical(body: RigidBody) -> bool:
    moments = np.linalg.eigvalsh(body.inertia)
    return bool(moments[0] > 0 and moments[2] <= moments[0] + moments[1])


def _write_inertial(scene: Mjcf, document: Document, element: int, body: int, in_site: RigidBody) -> None:
    """The inertial of one body, of which only what differs is written."""
    data, model = scene.in_reference_pose(), scene.model
    to_world = data.site_xmat[scene.site].reshape(3, 3)
    rotation = to_world.T @ data.xmat[body].reshape(3, 3)  # the body's axes in the site's frame
    position = to_world.T @ (data.xpos[body] - data.site_xpos[scene.site])
    new = in_site.seen_from(rotation, position)
    axes = _axes(model.body_iquat[body])
    old = RigidBody(
        float(model.body_mass[body]), model.body_ipos[body], axes @ np.diag(model.body_inertia[body]) @ axes.T
    )
    values = {"pos": numbers(new.center), "mass": numbers([new.mass]), "fullinertia": numbers(new.inertia[_FULL])}
    there = document.children(element, "inertial")
    if not there:
        words = " ".join(f'{name}="{value}"' for name, value in values.items())
        document.insert(element, f"<inertial {words}/>")
        return
    if abs(new.mass - old.mass) > SAME * old.mass:
        document.set(there[0], "mass", values["mass"])
    if np.abs(new.center - old.center).max() > SAME:
        document.set(there[0], "pos", values["pos"])
    if np.abs(new.inertia - old.inertia).max() > 1e-7 * np.abs(old.inertia).max():
        for name in (*ORIENTATIONS, "diaginertia"):
            document.set(there[0], name, None)
        document.set(there[0], "fullinertia", values["fullinertia"])


_FULL = (np.array([0, 1, 2, 0, 0, 1]), np.array([0, 1, 2, 1, 2, 2]))
"""Rows and columns of MuJoCo's fullinertia: xx yy zz xy xz yz."""


def _mend_site(texts: _Texts, physics: Physics) -> str:
    """Turn and move the site of the sensor; what hinders it, or ""."""
    turn, shift = physics.sensor_rotation, physics.sensor_position
    if np.allclose(turn, np.eye(3), atol=SAME) and np.allclose(shift, 0, atol=SAME):
        return ""
    model, site = texts.scene.model, texts.scene.site
    place = texts.find("site", name=texts.site_name)
    if place is None or place[0].elements[place[0].elements[place[1]].parent].tag != "body":
        return "the sensor's site does not stand right in a <body> of the files"
    document, element = place
    axes = _axes(model.site_quat[site])
    if np.abs(shift).max() > SAME:
        document.set(element, "pos", numbers(model.site_pos[site] + axes @ shift))
    for name in ORIENTATIONS:
        document.set(element, name, None)
    document.set(element, "quat", numbers(quaternions_of((axes @ turn)[None])[0]))
    return ""


def _axes(quaternion: Array) -> Array:
    """(3, 3) of a quaternion w, x, y, z."""
    import mujoco

    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, quaternion)
    return axes.reshape(3, 3)


def _mend_gravity(texts: _Texts, physics: Physics) -> str:
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


def _mend_joints(texts: _Texts, physics: Physics) -> str:
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


def _mend_cable(texts: _Texts, physics: Physics) -> str:
    """A tendon between two new sites: it pulls with its stiffness beyond its rest length, and never pushes."""
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

    def in_body(body: int, world: Array) -> str:
        return numbers(data.xmat[body].reshape(3, 3).T @ (world - data.xpos[body]))

    to_world, site = data.xmat[scene.base].reshape(3, 3), data.site_xmat[scene.site].reshape(3, 3)
    at_sensor = physics.sensor_position + physics.sensor_believed @ cable["attachment"]
    ends = {
        "ftbias_cable_near": (*near, scene.body, data.site_xpos[scene.site] + site @ at_sensor),
        "ftbias_cable_far": (*far, carrier, data.xpos[scene.base] + to_world @ cable["anchor"]),
    }
    for name, (document, element, body, point) in ends.items():
        document.insert(element, f'<site name="{name}" pos="{in_body(body, point)}" group="4"/>')
    stiffness, length = numbers([cable["stiffness"]]), numbers([cable["rest_length"]])
    sites = "".join(f'\n    <site site="{name}"/>' for name in ends)
    tendon = f'<spatial name="ftbias_cable" stiffness="{stiffness}" springlength="0 {length}">{sites}\n  </spatial>'
    texts.documents[0].insert(0, f"<tendon>\n  {tendon}\n</tendon>")
    return ""
