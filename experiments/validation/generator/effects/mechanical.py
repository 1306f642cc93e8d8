"""Effects of the catalogue that change the mechanics; MuJoCo computes their wrench."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from validation.generator.arms import Arm, Floats
from validation.generator.effects.effect import Draw, Effect, Scene
from validation.generator.effects.sprung import Sprung
from validation.generator.nominal_model import Tool
from validation.generator.world import Cable, cable_length, tool_path


def tool_mass(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: "denser" (inertia in proportion), "point_at_com" (a compact mass at the centre, inertia unchanged)."""
    relative = draw.sign() * min(draw.size((0.025, 0.05), (0.07, 0.13), (0.15, 0.25)), 0.4)
    grown = 1 + relative if form == "denser" else 1.0

    def heavier(tool: Tool) -> Tool:
        return replace(tool, mass=tool.mass * (1 + relative), inertia=tool.inertia * grown)

    parameters = {"mass": heavier(scene.belief.tool).mass, "relative": relative}
    return Effect("tool_mass", form, parameters, world=lambda world: replace(world, tool=heavier(world.tool)))


def tool_com(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: "any_direction", "sideways" (across the sensor axis)."""
    direction = draw.direction() * (1, 1, form != "sideways")
    size = draw.size((0.002, 0.004), (0.006, 0.01), (0.015, 0.03))
    shift = size * direction / np.linalg.norm(direction)
    com = scene.belief.tool.com + shift
    return Effect(
        "tool_com",
        form,
        {"com": com.tolist(), "shift": shift.tolist()},
        world=lambda world: replace(world, tool=replace(world.tool, com=com)),
    )


def tool_inertia(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: "larger" (all moments in proportion), "rod" (two masses moved apart along a line)."""
    nominal = scene.belief.tool.inertia
    relative = draw.size((0.5, 1.0), (1.2, 2.5), (3.0, 6.0))
    line = draw.direction()
    extra = nominal if form == "larger" else np.trace(nominal) / 2 * (np.eye(3) - np.outer(line, line))
    inertia = nominal + relative * extra
    parameters = {"inertia": inertia[np.triu_indices(3)].tolist(), "relative": relative}
    return Effect(
        "tool_inertia", form, parameters, world=lambda world: replace(world, tool=replace(world.tool, inertia=inertia))
    )


def gravity_tilt(form: str, draw: Draw, scene: Scene) -> Effect:
    """Base that is not level. Forms: "any_direction", "one_axis" (about base x or y; z for a wall mount)."""
    g = scene.belief.gravity
    axis = np.eye(3)[draw.rng.choice(np.flatnonzero(g == 0))] if form == "one_axis" else np.cross(g, draw.direction())
    angle = draw.sign() * np.radians(draw.size((0.5, 0.9), (1.2, 2.5), (3.0, 6.0)))
    gravity = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).apply(g)
    parameters = {"gravity": gravity.tolist(), "angle_deg": float(np.degrees(abs(angle)))}
    return Effect("gravity_tilt", form, parameters, world=lambda world: replace(world, gravity=gravity))


def mount_rotation(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: "sensor_axes" (only the measurement axes are rotated), "sensor_and_tool" (both rotated on the flange)."""
    angle = np.radians(draw.size((0.6, 1.0), (2.0, 3.5), (4.0, 8.0)))
    turn = Rotation.from_rotvec(angle * draw.direction())
    parameters = {"rpy": turn.as_euler("xyz").tolist()}
    if form == "sensor_axes":
        return Effect("mount_rotation", form, parameters, world=lambda w: replace(w, sensor_axes=turn.as_matrix()))
    return Effect(
        "mount_rotation",
        form,
        parameters,
        world=lambda world: replace(world, mount_rotation=world.mount_rotation @ turn.as_matrix()),
    )


def encoder_offset(form: str, draw: Draw, scene: Scene) -> Effect:
    """One encoder reads ``offset`` too much. Forms: "constant", "eccentric" (plus a small error once per turn)."""
    n = len(scene.belief.arm.home)
    column = int(draw.rng.integers(1, n))  # an offset of joint 1 of an upright arm is unobservable
    offset = draw.sign() * np.radians(draw.size((0.4, 0.8), (1.5, 2.5), (4.0, 7.0)))
    phase = draw.rng.uniform(0, 2 * np.pi)
    wobble = 0.15 * offset if form == "eccentric" else 0.0

    def error(q: Floats) -> Floats:
        out = np.zeros_like(q)
        out[:, column] = offset + wobble * np.sin(q[:, column] + phase)
        return out

    parameters = {"joint": column + 1, "offset": float(offset)}
    return Effect("encoder_offset", form, parameters, world=lambda world: replace(world, joint_error=error))


def joint_flexibility(form: str, draw: Draw, scene: Scene) -> Effect:
    """Joints that give way under the weight of links and tool. Forms: "one_joint", "all_joints"."""
    arm, rng, g = scene.belief.arm, draw.rng, scene.belief.gravity
    n = len(arm.home)
    masses = np.append(rng.uniform(0.5, 1.0, n) * np.linspace(6.0, 1.0, n), scene.belief.tool.mass)
    middles = (arm.points + np.append(arm.points[1:], arm.flange_position[None], axis=0)) / 2
    bodies = np.append(middles, arm.flange_position[None], axis=0)
    at_home = np.abs(_gravity_torques(arm, arm.home[None], masses, bodies, g)[0])
    compliance = rng.uniform(0.5, 1.5, n)
    if form == "one_joint":
        compliance *= np.arange(n) == rng.choice(np.flatnonzero(at_home > 0.2 * at_home.max()))
    largest = np.radians(draw.size((0.3, 0.6), (0.8, 1.5), (2.0, 4.0)))
    compliance *= largest / np.max(compliance * at_home)

    def error(q: Floats) -> Floats:
        return -compliance * _gravity_torques(arm, q, masses, bodies, g)

    parameters = {"rad_per_Nm": compliance.tolist(), "largest_at_home": largest}
    return Effect("joint_flexibility", form, parameters, world=lambda world: replace(world, joint_error=error))


def _gravity_torques(arm: Arm, q: Floats, masses: Floats, bodies: Floats, g: Floats) -> Floats:
    """Torque (T, n) Nm of the weight of bodies, (n + 1,) kg at (n + 1, 3) m at q = 0, about the axes of an arm.

    Body k is on link k; the last one is on the last link, too.
    """
    n = len(arm.home)
    turn, shift = Rotation.from_matrix(np.tile(np.eye(3), (len(q), 1, 1))), np.zeros((len(q), 3))
    axes, points, centres = [], [], []
    for k in range(n):
        axes.append(turn.apply(arm.axes[k]))
        points.append(turn.apply(arm.points[k]) + shift)
        turn = turn * Rotation.from_rotvec(q[:, k, None] * arm.axes[k])
        shift = points[k] - turn.apply(arm.points[k])
        centres.append(turn.apply(bodies[k]) + shift)
    centres.append(turn.apply(bodies[n]) + shift)
    torques = np.zeros((len(q), n))
    for k in range(n):
        for body in range(k, n + 1):
            moment = np.cross(centres[body] - points[k], masses[body] * g)
            torques[:, k] += np.einsum("ti,ti->t", moment, axes[k])
    return torques


def cable(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: anchor on the "forearm" or in the "world"; "stiffening": a second, longer strand tightens later."""
    arm, rng = scene.belief.arm, draw.rng
    on_forearm = form != "world"
    end = scene.belief.tool.com + rng.uniform(-0.04, 0.04, 3)
    times = np.linspace(0, scene.duration, 200)
    if on_forearm:
        anchor = arm.points[arm.forearm] + rng.uniform(-0.08, 0.08, 3)
    else:
        anchor = (
            tool_path(scene.world, scene.motion, times).points(end).mean(0) + rng.uniform(0.3, 0.6) * draw.direction()
        )
    stiffness = draw.size((4.0, 8.0), (15.0, 30.0), (40.0, 80.0))
    strand = Cable(stiffness, 0.0, anchor, on_forearm, end)
    world = replace(scene.world, cables=(strand,))
    distance = cable_length(world, scene.motion, times)
    first = replace(strand, length=float(np.quantile(distance, rng.uniform(0.0, 0.3)) * rng.uniform(0.7, 1.0)))
    second = replace(first, length=float(np.quantile(distance, 0.6)))
    strands = (first, second) if form == "stiffening" else (first,)
    parameters = {"stiffness": stiffness, "length": first.length, "anchor": "forearm" if on_forearm else "world"}
    parameters |= {"anchor_point": anchor.tolist(), "tool_point": end.tolist()}
    return Effect("cable", form, parameters, world=lambda world: replace(world, cables=strands))


FLEXIBLE = {
    "lateral_balanced": ("lateral", True),
    "pivot_balanced": ("pivot", True),
    "one_hinge_balanced": ("hinge", True),
    "lateral_sagging": ("lateral", False),
}


def tool_flexibility(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: see FLEXIBLE; without a balance, in "lateral_sagging", the springs also deflect under gravity."""
    kind, balanced = FLEXIBLE[form]
    low, high = (4.0, 14.0) if balanced else (9.0, 25.0)
    softness = draw.size((0.1, 0.4), (0.4, 0.7), (0.8, 1.0))
    hz = max(low, high * (low / high) ** softness)
    zeta = float(draw.rng.uniform(0.01, 0.08))
    part = Sprung(kind, float(draw.rng.uniform(0.6, 0.95)), hz, zeta, balanced)
    parameters = {"hz": hz, "zeta": zeta, "share": part.share}
    return Effect("tool_flexibility", form, parameters, world=lambda world: replace(world, sprung=part))
