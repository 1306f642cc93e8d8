"""Actual tool, mounting, gravity and joints according to a setup with the effects that a diagnosis found."""

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
"""Effects that a simulator's own file can express."""
DRAG = {"drive": "velocity", "form": "linear", "frame": "base", "acts_as": "force"}
"""Term that such a file can express: a force against the velocity of a point of the tool, equal in all directions."""

SAME = 1e-9
"""Relative difference below which values are left as they are in the file."""


class Mended(NamedTuple):
    """Corrected file of a simulator."""

    files: dict[str, str]
    """Path -> text, the file itself first, then changed copies of the files that it includes."""
    not_expressed: list[dict[str, Any]]
    """Effects that the format cannot express: effect, parameters, why."""


class Physics(NamedTuple):
    """Actual robot and tool, in contrast to the nominal ones of the setup."""

    tool: RigidBody
    """Inertial parameters, in the sensor frame as the setup states its mounting."""
    gravity: Array
    """(3,) m/s^2, base frame."""
    sensor_nominal: Array
    """(3, 3) nominal axes of the sensor in the flange frame, as the setup states them."""
    sensor_rotation: Array
    """(3, 3) actual axes of the sensor in the flange frame."""
    sensor_position: Array
    """(3,) m, actual origin of the sensor in the flange frame."""
    offsets: Array
    """(n,) rad: recorded minus true angle of each joint."""
    cable: Mapping[str, Array] | None
    """All parameters of the effect, omitted ones at their neutral value; None = no cable."""
    flexibility: Mapping[str, Array] | None
    """All parameters of the effect, omitted ones at their neutral value; None = no flexible tool."""


@in_float64
def physics_of(setup: Setup) -> Physics:
    """Actual robot and tool that the setup of an arm states by its effects.

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
        sensor_nominal=setup.sensor.rotation,
        sensor_rotation=setup.sensor.rotation @ rotation_from_vector(turn),
        sensor_position=setup.sensor.translation + setup.sensor.rotation @ shift,
        offsets=-np.asarray(moved.q)[0],
        cable=cable,
        flexibility=flexibility,
    )


def is_drag(section: Mapping[str, Any]) -> bool:
    """Whether a term is a drag that a simulator's own file can express."""
    return DRAG.items() <= section.items() and bool(np.all(np.asarray(section["coefficients"]) > 0))


def without_drag(effects: Mapping[str, Any]) -> dict[str, Any]:
    """Effects of a setup without such drag terms."""
    left = [section for section in effects.get(TERM, ()) if not is_drag(section)]
    return {**{name: x for name, x in effects.items() if name != TERM}, **({TERM: left} if left else {})}


def check_arm(setup: Setup, theirs: RobotSetup, file: str, draft: str) -> None:
    """Refuse a file whose arm is not that of the setup; ``draft`` is the option that drafts a setup from it.

    Raises:
        SetupError: the joints' screw axes differ.
    """
    screws = setup.robot.screws
    if theirs.screws.shape != screws.shape or not np.allclose(theirs.screws, screws, atol=1e-6):
        remedy = f"draft the setup from it: ftbias setup {draft}"
        raise SetupError("its arm is not the one of the setup", file=file, field="robot", remedy=remedy)


def same_body(one: RigidBody, other: RigidBody) -> bool:
    """Whether two bodies differ only by rounding."""
    size = np.abs(other.inertia).max() + SAME
    return bool(
        abs(one.mass - other.mass) <= SAME * other.mass
        and np.allclose(one.center, other.center, rtol=0, atol=SAME)
        and np.allclose(one.inertia, other.inertia, rtol=0, atol=1e-7 * size)
    )


def not_expressed(effects: Mapping[str, Any], expressed: Iterable[str]) -> list[dict[str, Any]]:
    """Effects of a setup that neither the simulator's file (names ``expressed``) nor the sensor model can express."""
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
