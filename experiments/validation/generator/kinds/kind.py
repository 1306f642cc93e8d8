"""What a withheld kind is: where its extra wrench comes from, how it is drawn, and how it is put into a scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from validation.generator.arms import Floats
from validation.generator.effects.effect import Draw, Effect, Scene, uneven
from validation.generator.world import Couple, Load, World

Parameters = dict[str, Any]
"""Numbers, words and lists of numbers: all that there is to know about an effect, whatever the motion."""
Hooks = dict[str, Any]
"""Hooks of an ``Effect`` by their names."""
Sampler = Callable[[str, Draw, Scene], Any]
"""Form, sizes, scene -> the value of a parameter."""


@dataclass(frozen=True)
class Kind:
    """One cause that no catalogue knows."""

    name: str
    drive: str
    """What its extra wrench follows: one of the drives of a diagnosis' terms."""
    frame: str
    """base, sensor, joint or none: the axes in which it is simple."""
    acts_as: str
    """force, torque, wrench, bias or noise."""
    forms: tuple[str, str]
    """Two functional forms."""
    samplers: Mapping[str, Sampler] | Callable[[str, Draw, Scene], Parameters]
    """How the parameters are drawn, in this order; they grow with the scale of the draw."""
    hooks: Callable[[str, Any, Scene], Hooks]
    """Form, parameters as attributes (lists as arrays), scene -> what the effect does in this scene."""
    known: Callable[[str, Any], Mapping[str, Any]] = lambda form, p: {}
    """Form, parameters -> unit (as in ``N_per_m_s``) or parameter -> number or list, where one number says it all."""
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

    def draw(self, form: str, draw: Draw, scene: Scene) -> Parameters:
        """Parameters at random."""
        if callable(self.samplers):
            return plain(self.samplers(form, draw, scene))
        return plain({name: sample(form, draw, scene) for name, sample in self.samplers.items()})

    def build(self, form: str, parameters: Parameters, scene: Scene) -> Effect:
        """The effect in this scene; another scene gives the same effect in another motion."""
        return Effect(self.name, form, parameters, **self.hooks(form, attributes(parameters), scene))

    def coefficients(self, form: str, parameters: Parameters) -> dict[str, Any]:
        """As a label says them."""
        return plain(self.known(form, attributes(parameters)))


def attributes(parameters: Parameters) -> SimpleNamespace:
    """Parameters by name, lists of numbers as arrays."""
    return SimpleNamespace(
        **{name: np.array(value) if isinstance(value, list) else value for name, value in parameters.items()}
    )


def plain(values: Mapping[str, Any]) -> Parameters:
    """As JSON has them."""
    return {
        name: value.tolist() if isinstance(value, np.ndarray | np.generic) else value for name, value in values.items()
    }


def times(size: float) -> Sampler:
    """So many times the scale."""
    return lambda form, draw, scene: size * draw.scale


def between(low: float, high: float) -> Sampler:
    """A number, whatever the scale."""
    return lambda form, draw, scene: float(draw.rng.uniform(low, high))


def of_duration(low: float, high: float) -> Sampler:
    """s, from one share of the log to another."""
    return lambda form, draw, scene: float(draw.rng.uniform(low, high) * scene.duration)


def directed(size: float) -> Sampler:
    """(3,) of any direction, so many times the scale."""
    return lambda form, draw, scene: size * draw.scale * draw.direction()


def direction(form: str, draw: Draw, scene: Scene) -> Floats:
    """(3,) unit vector."""
    return draw.direction()


def amplitudes(size: float) -> Sampler:
    """(6,) N, Nm, so many times the scale."""
    return lambda form, draw, scene: uneven(draw, size * draw.scale)


def shares(size: float, low: float) -> Sampler:
    """(6,) of either sign, from ``low`` times to once this size times the scale."""
    return lambda form, draw, scene: size * draw.scale * draw.signs() * draw.rng.uniform(low, 1.0, 6)


def near_com(reach: float = 0.05) -> Sampler:
    """(3,) m, a point in a box of half the edge ``reach`` around the centre of mass."""
    return lambda form, draw, scene: scene.belief.tool.com + draw.rng.uniform(-reach, reach, 3)


def last_joint(form: str, draw: Draw, scene: Scene) -> int:
    """Its number, from 1."""
    return len(scene.belief.arm.home)


def pushed(load: Load, *couples: Couple) -> Hooks:
    """An external force, with torques that go with it."""

    def world(world: World) -> World:
        return replace(world, loads=(*world.loads, load), couples=(*world.couples, *couples))

    return {"world": world}


def twisted(couple: Couple) -> Hooks:
    """An external torque."""
    return {"world": lambda world: replace(world, couples=(*world.couples, couple))}


def last_axis(world: World) -> Floats:
    """(3,) axis of the last joint in the tool frame, where it stays."""
    axis: Floats = world.mount_rotation.T @ world.arm.flange_rotation.T @ world.arm.axes[-1]
    return axis / np.linalg.norm(axis)
