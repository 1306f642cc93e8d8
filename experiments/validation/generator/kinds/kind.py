"""What a withheld kind is: where its extra wrench comes from, how it is drawn, and how it is put into a scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from validation.generator.arms import Floats
from validation.generator.effects.effect import Draw, Effect, Scene
from validation.generator.world import Couple, Load, World

Parameters = dict[str, Any]
"""Numbers, words and lists of numbers: all that there is to know about an effect, whatever the motion."""


def _no_coefficients(form: str, parameters: Parameters) -> dict[str, Any]:
    return {}


@dataclass(frozen=True)
class Kind:
    """One cause that no catalogue knows."""

    drive: str
    """What its extra wrench follows: one of the drives of a diagnosis' terms."""
    frame: str
    """base, sensor, joint or none: the axes in which it is simple."""
    acts_as: str
    """force, torque, wrench, bias or noise."""
    forms: tuple[str, str]
    """Two functional forms."""
    draw: Callable[[str, Draw, Scene], Parameters]
    """Form, sizes, scene -> parameters; they grow with the scale of the draw."""
    build: Callable[[str, Parameters, Scene], Effect]
    """Form, parameters, scene -> the effect in this scene; another scene gives the same effect in another motion."""
    unseen: bool = False
    """Kept until the end: no one who builds the diagnosis looks at it."""
    equivalent: tuple[str, ...] = ()
    """Drives that say the same in other words, by physics: right answers, too."""
    equivalent_forms: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Form -> more of them, of this form alone."""
    sometimes: tuple[str, ...] = ()
    """Drives that say the same in some motions: right answers where they predict the extra wrench (``likeness``)."""
    twins: tuple[str, ...] = ()
    """Effects of the package's catalogue that say nearly the same: not counted as wrong names."""
    brisk: bool = False
    """Slow motion hides it."""
    coefficients: Callable[[str, Parameters], dict[str, Any]] = field(default=_no_coefficients)
    """Form, parameters -> unit (as in ``N_per_m_s``) or parameter -> number or list, where one number says it all."""


def vector(values: Floats) -> list[float]:
    """As the label has it."""
    return [float(x) for x in values]


def near(point: Floats, draw: Draw, reach: float = 0.05) -> Floats:
    """(3,) m, a point in a box of half the edge ``reach`` around that point."""
    return point + draw.rng.uniform(-reach, reach, 3)


def loaded(name: str, form: str, parameters: Parameters, load: Load, *couples: Couple) -> Effect:
    """An external force as an effect, with torques that go with it."""

    def pushed(world: World) -> World:
        return replace(world, loads=(*world.loads, load), couples=(*world.couples, *couples))

    return Effect(name, form, parameters, world=pushed)


def twisted(name: str, form: str, parameters: Parameters, couple: Couple) -> Effect:
    """An external torque as an effect."""
    return Effect(name, form, parameters, world=lambda world: replace(world, couples=(*world.couples, couple)))


def last_axis(world: World) -> Floats:
    """(3,) axis of the last joint in the tool frame, where it stays."""
    axis: Floats = world.mount_rotation.T @ world.arm.flange_rotation.T @ world.arm.axes[-1]
    return axis / np.linalg.norm(axis)
