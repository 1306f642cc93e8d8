"""Definition of a withheld kind: its physics and drive, how its parameters are drawn, and its effect in a scene."""

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
"""Numbers, strings and lists of numbers that define an effect completely, independently of the motion."""
Hooks = dict[str, Any]
"""Hooks of an ``Effect`` by their names."""
Sampler = Callable[[str, Draw, Scene], Any]
"""Form, source of sizes, scene -> value of a parameter."""


@dataclass(frozen=True)
class Kind:
    """One cause that is in no catalogue."""

    name: str
    drive: str
    """Quantity on which the extra wrench depends: one of the drives of a diagnosis's terms."""
    frame: str
    """Axes in which it has a simple form: base, sensor, joint or none."""
    acts_as: str
    """force, torque, wrench, bias or noise."""
    forms: tuple[str, str]
    """Two functional forms."""
    samplers: Mapping[str, Sampler] | Callable[[str, Draw, Scene], Parameters]
    """Samplers of the parameters, in the order of drawing; sizes grow with the scale of the draw."""
    hooks: Callable[[str, Any, Scene], Hooks]
    """Form, parameters as attributes (lists as arrays), scene -> hooks of the effect in this scene."""
    known: Callable[[str, Any], Mapping[str, Any]] = lambda form, p: {}
    """Form, parameters -> unit (as in ``N_per_m_s``) or parameter -> number or list, if one describes it completely."""
    unseen: bool = False
    """Whether the kind is kept for the end, unseen by those who build the diagnosis."""
    equivalent: tuple[str, ...] = ()
    """Physically equivalent drives, which count as right answers, too."""
    equivalent_forms: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Form -> further equivalent drives of this form alone."""
    sometimes: tuple[str, ...] = ()
    """Drives that are equivalent in some motions; right answers where they predict the extra wrench (``likeness``)."""
    twins: tuple[str, ...] = ()
    """Effects of the package's catalogue that are nearly the same and do not count as wrong names."""
    brisk: bool = False
    """Whether its logs need brisk motion, because slow motion does not reveal it."""

    def draw(self, form: str, draw: Draw, scene: Scene) -> Parameters:
        """Draw the parameters."""
        if callable(self.samplers):
            return plain(self.samplers(form, draw, scene))
        return plain({name: sample(form, draw, scene) for name, sample in self.samplers.items()})

    def build(self, form: str, parameters: Parameters, scene: Scene) -> Effect:
        """Build the effect in a scene; another scene gives the same effect in another motion."""
        return Effect(self.name, form, parameters, **self.hooks(form, attributes(parameters), scene))

    def coefficients(self, form: str, parameters: Parameters) -> dict[str, Any]:
        """Return the coefficients of the effect in the format of a label."""
        return plain(self.known(form, attributes(parameters)))


def attributes(parameters: Parameters) -> SimpleNamespace:
    """Return the parameters as attributes, with lists of numbers as arrays."""
    return SimpleNamespace(
        **{name: np.array(value) if isinstance(value, list) else value for name, value in parameters.items()}
    )


def plain(values: Mapping[str, Any]) -> Parameters:
    """Return the values as JSON types, with arrays as lists."""
    return {
        name: value.tolist() if isinstance(value, np.ndarray | np.generic) else value for name, value in values.items()
    }


def times(size: float) -> Sampler:
    """Sampler of ``size`` times the scale."""
    return lambda form, draw, scene: size * draw.scale


def between(low: float, high: float) -> Sampler:
    """Sampler of a uniform number that is independent of the scale."""
    return lambda form, draw, scene: float(draw.rng.uniform(low, high))


def of_duration(low: float, high: float) -> Sampler:
    """Sampler of a time in s, uniform between two shares of the log's duration."""
    return lambda form, draw, scene: float(draw.rng.uniform(low, high) * scene.duration)


def directed(size: float) -> Sampler:
    """Sampler of a vector (3,) in a random direction with the length ``size`` times the scale."""
    return lambda form, draw, scene: size * draw.scale * draw.direction()


def direction(form: str, draw: Draw, scene: Scene) -> Floats:
    """Sampler of a unit vector (3,)."""
    return draw.direction()


def amplitudes(size: float) -> Sampler:
    """Sampler of signed amplitudes (6,) N, Nm around ``size`` times the scale."""
    return lambda form, draw, scene: uneven(draw, size * draw.scale)


def shares(size: float, low: float) -> Sampler:
    """Sampler of numbers (6,) of random sign, of ``low`` to 1 times ``size`` times the scale."""
    return lambda form, draw, scene: size * draw.scale * draw.signs() * draw.rng.uniform(low, 1.0, 6)


def near_com(reach: float = 0.05) -> Sampler:
    """Sampler of a point (3,) m in a cube of half edge ``reach`` around the centre of mass."""
    return lambda form, draw, scene: scene.belief.tool.com + draw.rng.uniform(-reach, reach, 3)


def last_joint(form: str, draw: Draw, scene: Scene) -> int:
    """Sampler of the number of the last joint, counted from 1."""
    return len(scene.belief.arm.home)


def pushed(load: Load, *couples: Couple) -> Hooks:
    """Hooks for an external force and accompanying torques."""

    def world(world: World) -> World:
        return replace(world, loads=(*world.loads, load), couples=(*world.couples, *couples))

    return {"world": world}


def twisted(couple: Couple) -> Hooks:
    """Hooks for an external torque."""
    return {"world": lambda world: replace(world, couples=(*world.couples, couple))}


def last_axis(world: World) -> Floats:
    """Axis (3,) of the last joint in the tool frame, where it is constant."""
    axis: Floats = world.mount_rotation.T @ world.arm.flange_rotation.T @ world.arm.axes[-1]
    return axis / np.linalg.norm(axis)
