"""All effects that change the mean reading as one differentiable model in unbounded coordinates.

One compiled function serves every effect and every combination: the chain of the catalogue is evaluated with all its
effects in place, most of them neutral. The motion of the arm, which only the joints' offsets change, is worked out
apart, because it is the same in nearly all evaluations.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.diagnosis.regression.coordinates import fitted_effects, layout, values_at
from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.catalogue import CATALOGUE, Catalogue
from ftbias_jax.model.effects.fitting import ByJoint
from ftbias_jax.model.effects.types import Effect, EffectValues, Signals, Values, motion_of
from ftbias_jax.model.kinematics.arm_batch import ArmMotion
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.types import Array


@keep_program("catalogue")
def to_values(signals: Signals, z: Array, *, catalogue: Catalogue = CATALOGUE) -> Values:
    """Catalogue values of all chained effects; those of one joint have a row of all joints and of their offsets."""
    return _values(signals, z, catalogue, fitted_effects(catalogue))


def _values(signals: Signals, z: Array, catalogue: Catalogue, effects: list[Effect]) -> Values:
    n = signals.q.shape[1]
    places = layout(n, catalogue).slices

    def of(effect: Effect) -> EffectValues:
        own = {parameter: z[place] for (name, parameter), place in places.items() if name == effect.name}
        return values_at(effect, signals.model, own, n)

    return {effect.name: of(effect) for effect in effects}


def _moved(signals: Signals, known: Values, z: Array, catalogue: Catalogue) -> Signals:
    """Joints without the offsets of coordinates z (P,), and without those that the setup knows of."""
    moving = catalogue.searched_by(ByJoint)
    moved = compose.transform(signals, _values(signals, z, catalogue, list(moving)), catalogue)
    stated = {effect.name: known[effect.name] for effect in moving if effect.name in known}
    return compose.transform(moved, stated, catalogue)


@keep_program("catalogue")
def motion(signals: Signals, known: Values, z: Array, *, catalogue: Catalogue = CATALOGUE) -> ArmMotion:
    """How the arm moves with the joint offsets of coordinates z (P,), and with those that the setup knows of."""
    return motion_of(_moved(signals, known, z, catalogue))


def nominal_motion(signals: Signals, known: Values, catalogue: Catalogue = CATALOGUE) -> ArmMotion:
    """How the arm moves with the joints where the setup believes."""
    nowhere = np.zeros(layout(signals.q.shape[1], catalogue).size)
    moving: ArmMotion = motion(signals, known, nowhere, catalogue=catalogue)
    return moving


@keep_program("catalogue")
def reading(signals: Signals, known: Values, moving: ArmMotion, z: Array, *, catalogue: Catalogue = CATALOGUE) -> Array:
    """(B, 6) N, Nm: noise-free reading at z (P,) with effects that the setup knows of; moving: the ``motion`` at z."""
    joints = [effect.name for effect in catalogue.searched_by(ByJoint)]
    chained = _values(signals, z, catalogue, [e for e in fitted_effects(catalogue) if e.name not in joints])
    values = chained | {name: known[name] for name in known if name not in joints}
    if catalogue.own:  # these may move the joints, or look at where they are
        signals = _moved(signals, known, z, catalogue)
    places, acting = layout(signals.q.shape[1], catalogue).slices, dict(catalogue)
    for name in (name for name in chained if name not in known):
        own = jnp.concatenate([z[place] for (effect, _), place in places.items() if effect == name])
        acting[name] = _only_if(jnp.any(own != 0), catalogue[name])
    return compose.predict(signals._replace(motion=moving), values, acting)


def _only_if(acts: Array, effect: Effect) -> Effect:
    """An effect whose change of the reading is not even worked out where it is neutral: most are, at any time."""
    if effect.reading is None:
        return effect
    change = effect.reading

    def reading(values: EffectValues, signals: Signals, wrench: Array) -> Array:
        return jax.lax.cond(acts, lambda: change(values, signals, wrench).astype(wrench.dtype), lambda: wrench)

    return effect._replace(reading=reading)
