"""What a setup with effects, as a diagnosis leaves it, says of the tool, the mounting, gravity and the joints."""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.errors import SetupError
from ftbias_jax.model.effects.catalogue import complete, values_from_setup
from ftbias_jax.model.effects.compose import transform
from ftbias_jax.model.effects.terms.parse import TERM
from ftbias_jax.model.effects.types import Model, Signals
from ftbias_jax.model.own_effects import catalogue_of_setup
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.model.wrench.inertia import about_center_of_mass
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup.bodies import RigidBody
from ftbias_jax.setup.rotations import rotation_from_vector
from ftbias_jax.setup.types import RobotSetup, Setup, inertia_matrix
from ftbias_jax.simulators.sensor_model import EFFECTS
from ftbias_jax.types import Array

OF_THE_ROBOT = (
    "tool_mass",
    "tool_com",
    "tool_inertia",
    "gravity_tilt",
    "mount_translation",
    "mount_rotation",
    "encoder_offset",
    "cable",
    "tool_flexibility",
)
"""Effects that a simulator's own file may state."""
DRAG = {"drive": "velocity", "form": "linear", "frame": "base", "acts_as": "force"}
"""A term that it may state: a force against the velocity of a point of the tool, alike in all directions."""

SAME = 1e-9
"""Relative: values nearer than this are left as they are written."""


class Mended(NamedTuple):
    """A simulator's file, mended."""

    files: dict[str, str]
    """Path -> text, the file itself first, then changed copies of what it includes."""
    not_expressed: list[dict[str, Any]]
    """What the format cannot say: effect, parameters, why."""


class Physics(NamedTuple):
    """The robot and its tool as they are."""

    tool: RigidBody
    """In the setup's sensor frame, as the setup believes it to be mounted."""
    gravity: Array
    """(3,) m/s^2, base frame."""
    sensor_believed: Array
    """(3, 3) the sensor's axes in the flange frame, as the setup believes."""
    sensor_rotation: Array
    """(3, 3) its true axes there."""
    sensor_position: Array
    """(3,) m, its true origin there."""
    offsets: Array
    """(n,) rad: recorded minus true angle of each joint."""
    cable: Mapping[str, Array] | None
    """Of the effect, with what it left out; None = there is none."""
    flexibility: Mapping[str, Array] | None
    """The same of a tool on springs."""


@in_float64
def physics_of(setup: Setup) -> Physics:
    """What the setup of an arm states, with its effects.

    Raises:
        SetupError: the tool is not known, or an effect has impossible values.
    """
    params, catalogue = params_from_setup(setup), catalogue_of_setup(setup)
    stated = values_from_setup(setup.effects, setup.path, catalogue)
    model = Model(params.arm, params.gravity, params.theta)
    of_robot = {name: complete(catalogue[name], stated[name], model) for name in OF_THE_ROBOT if name in stated}
    n = len(setup.robot.screws)
    time, joints = np.zeros(1), np.zeros((1, n))
    nowhere = Signals(time, joints, joints, joints, time, model)
    moved = transform(nowhere, of_robot, catalogue)
    theta: Array = np.asarray(moved.model.theta)
    mass, center, inertia = about_center_of_mass(theta)
    shift, turn = (
        np.asarray(of_robot[name][key]) if name in of_robot else np.zeros(3)
        for name, key in (("mount_translation", "translation"), ("mount_rotation", "rotation"))
    )
    cable, flexibility = (
        {key: np.asarray(x) for key, x in of_robot[name].items()} if name in of_robot else None
        for name in ("cable", "tool_flexibility")
    )
    return Physics(
        tool=RigidBody(float(mass), center, inertia_matrix(inertia)),
        gravity=np.asarray(moved.model.gravity),
        sensor_believed=setup.sensor.rotation,
        sensor_rotation=setup.sensor.rotation @ rotation_from_vector(turn),
        sensor_position=setup.sensor.translation + setup.sensor.rotation @ shift,
        offsets=-np.asarray(moved.q)[0],
        cable=cable,
        flexibility=flexibility,
    )


def is_drag(section: Mapping[str, Any]) -> bool:
    """Whether a term is one that a simulator's own file may state."""
    return DRAG.items() <= section.items() and bool(np.all(np.asarray(section["coefficients"]) > 0))


def without_drag(effects: Mapping[str, Any]) -> dict[str, Any]:
    """The effects of a setup without such terms."""
    left = [section for section in effects.get(TERM, ()) if not is_drag(section)]
    return {**{name: x for name, x in effects.items() if name != TERM}, **({TERM: left} if left else {})}


def check_arm(setup: Setup, theirs: RobotSetup, file: str, draft: str) -> None:
    """Refuse a file whose arm is not that of the setup; ``draft`` is the option that drafts a setup from it.

    Raises:
        SetupError: the joints' axes are elsewhere.
    """
    screws = setup.robot.screws
    if theirs.screws.shape != screws.shape or not np.allclose(theirs.screws, screws, atol=1e-6):
        remedy = f"draft the setup from it: ftbias setup {draft}"
        raise SetupError("its arm is not the one of the setup", file=file, field="robot", remedy=remedy)


def same_body(one: RigidBody, other: RigidBody) -> bool:
    """Whether they differ by rounding alone."""
    size = np.abs(other.inertia).max() + SAME
    return bool(
        abs(one.mass - other.mass) <= SAME * other.mass
        and np.allclose(one.center, other.center, rtol=0, atol=SAME)
        and np.allclose(one.inertia, other.inertia, rtol=0, atol=1e-7 * size)
    )


def not_expressed(effects: Mapping[str, Any], expressed: Iterable[str]) -> list[dict[str, Any]]:
    """What of a setup's effects neither the simulator's file, by the names ``expressed``, nor the sensor model says."""
    there = {*expressed, *EFFECTS}
    return [
        {"effect": name, "parameters": values, "why": WHY.get(name, OTHERS)}
        for name, values in effects.items()
        if name not in there
    ]


OTHERS = "the file has no element for it"
WHY = {
    "contact": "it happened in one recording, at its times",
    "payload_change": "it happened in one recording, at its times",
    "term": "it is described by what drives it, not by a part that a file could have",
    "clock_drift": "it is of one recording's clocks",
}
