"""All effects that change the mean reading as one differentiable model in unbounded coordinates.

One compiled function serves every effect and every combination: the chain of the catalogue is evaluated with all its
effects in place, most of them neutral. The motion of the arm, which only the joints' offsets change, is computed
separately, because it is the same in nearly all evaluations. The programs are loaded or compiled while the logs are
still being prepared for a search.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ftbias_jax.diagnosis.regression.coordinates import fitted_effects, layout, values_at
from ftbias_jax.diagnosis.samples.bins import bins_of
from ftbias_jax.diagnosis.samples.smoothed import padded_samples, programs_of_smoother
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.io.log import Log
from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.catalogue import CATALOGUE, Catalogue
from ftbias_jax.model.effects.fitting import ByJoint
from ftbias_jax.model.effects.types import Effect, EffectValues, Model, Signals, Values, motion_of
from ftbias_jax.model.kinematics.arm_batch import ArmMotion
from ftbias_jax.model.own_effects import catalogue_of_setup
from ftbias_jax.model.params import Params, params_from_setup
from ftbias_jax.runtime.jax_config import same_precision
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array

WORKERS = 2
"""Number of programs that are compiled concurrently."""


@keep_program("catalogue")
def to_values(signals: Signals, z: Array, *, catalogue: Catalogue = CATALOGUE) -> Values:
    """Catalogue values of all chained effects; an effect of one joint has arrays of all joints and their offsets."""
    return _values(signals, z, catalogue, fitted_effects(catalogue))


def _values(signals: Signals, z: Array, catalogue: Catalogue, effects: list[Effect]) -> Values:
    n = signals.q.shape[1]
    places = layout(n, catalogue).slices

    def of(effect: Effect) -> EffectValues:
        own = {parameter: z[place] for (name, parameter), place in places.items() if name == effect.name}
        return values_at(effect, signals.model, own, n)

    return {effect.name: of(effect) for effect in effects}


def _moved(signals: Signals, known: Values, z: Array, catalogue: Catalogue) -> Signals:
    """Signals with the joint offsets of coordinates z (P,) and those stated in the setup taken out of the joints.

    An effect that depends on the pose gets that of all effects before it in the catalogue, stated or not.
    """
    moving = catalogue.searched_by(ByJoint)
    found = _values(signals, z, catalogue, list(moving))
    for name in (effect.name for effect in moving):
        for values in ([known[name]] if name in known else []) + [found[name]]:
            signals = compose.transform(signals, {name: values}, catalogue)
    return signals


@keep_program("catalogue")
def motion(signals: Signals, known: Values, z: Array, *, catalogue: Catalogue = CATALOGUE) -> ArmMotion:
    """Motion of the arm with the joint offsets of coordinates z (P,) and those stated in the setup."""
    return motion_of(_moved(signals, known, z, catalogue))


def nominal_motion(signals: Signals, known: Values, catalogue: Catalogue = CATALOGUE) -> ArmMotion:
    """Nominal motion of the arm, with no joint offsets but those stated in the setup."""
    nowhere = np.zeros(layout(signals.q.shape[1], catalogue).size)
    return motion(signals, known, nowhere, catalogue=catalogue)


@keep_program("catalogue")
def reading(signals: Signals, known: Values, moving: ArmMotion, z: Array, *, catalogue: Catalogue = CATALOGUE) -> Array:
    """(B, 6) N, Nm: noise-free reading at z (P,) with the effects stated in the setup; moving: the ``motion`` at z."""
    joints = [effect.name for effect in catalogue.searched_by(ByJoint)]
    chained = _values(signals, z, catalogue, [e for e in fitted_effects(catalogue) if e.name not in joints])
    values = chained | {name: known[name] for name in known if name not in joints}
    if catalogue.own:  # these may move the joints or depend on their positions
        signals = _moved(signals, known, z, catalogue)
    places, acting = layout(signals.q.shape[1], catalogue).slices, dict(catalogue)
    for name in (name for name in chained if name not in known):
        own = jnp.concatenate([z[place] for (effect, _), place in places.items() if effect == name])
        acting[name] = _only_if(jnp.any(own != 0), catalogue[name])
    return compose.predict(signals._replace(motion=moving), values, acting)


def _only_if(acts: Array, effect: Effect) -> Effect:
    """An effect whose change of the reading is computed only where it acts, because most are neutral at any time."""
    if effect.reading is None:
        return effect
    change = effect.reading

    def reading(values: EffectValues, signals: Signals, wrench: Array) -> Array:
        return jax.lax.cond(acts, lambda: change(values, signals, wrench).astype(wrench.dtype), lambda: wrench)

    return effect._replace(reading=reading)


@contextmanager
def compiled_ahead(setup: Setup, logs: Sequence[Log]) -> Iterator[None]:
    """Compile the programs of a search on these logs while the block runs, and wait for them at its end.

    If the block fails, it does not wait: compilations in progress finish in the background and are kept. Errors of XLA
    in a compilation are raised at the end of the block.
    """
    worker = ThreadPoolExecutor(WORKERS)
    try:
        compiling = [worker.submit(same_precision(prepare)) for prepare in programs_of_search(setup, logs)]
        yield
        for one in compiling:
            one.result()
    finally:
        worker.shutdown(wait=False, cancel_futures=True)


def programs_of_search(setup: Setup, logs: Sequence[Log]) -> Iterator[Callable[[], object]]:
    """Functions that load or compile the programs of a search on these logs, those of the joint smoother first.

    There is one set of programs per padded length. A log that loses bins while it is cleaned may turn out shorter; its
    programs are then compiled at their first call.
    """
    params, options = params_from_setup(setup), Options(joint_model=setup.joints.model)
    outlines = (jax.eval_shape(lambda samples: samples, padded_samples(log)) for log in logs)
    for samples in {str(outline): outline for outline in outlines}.values():
        yield from programs_of_smoother(params, samples, options)
    catalogue = catalogue_of_setup(setup)
    for bins, columns in dict.fromkeys((padded_bins(log), tuple(log.columns)) for log in logs):
        signals, known, moving = outline(params, bins, columns)
        z = jax.ShapeDtypeStruct((layout(signals.q.shape[1], catalogue).size,), signals.q.dtype)
        # The program that takes longest to compile comes first.
        yield partial(reading.prepare, signals, known, moving, z, catalogue=catalogue)
        yield partial(motion.prepare, signals, known, z, catalogue=catalogue)
        yield partial(to_values.prepare, signals, z, catalogue=catalogue)


def outline(params: Params, bins: int, columns: Sequence[str] = ()) -> tuple[Signals, Values, ArmMotion]:
    """Signals, stated effects and motion as ``problem.make_problem`` makes them of a log, as shapes only."""
    n = params.joint.process_density.shape[0]

    def of(*shape: int) -> Any:
        return jax.ShapeDtypeStruct((bins, *shape), params.theta.dtype)

    model, seen = Model(params.arm, params.gravity, params.theta), {name: of() for name in columns}
    signals = Signals(of(), of(n), of(n), of(n), of(), model, columns=seen)
    return signals, params.effects or {}, jax.eval_shape(motion_of, signals)


def padded_bins(log: Log) -> int:
    """Number of bins that a log has with padding, if no sample is discarded."""
    measured = np.isfinite(log.wrench).any(1)
    return bins_of(log.t[measured], float(log.t[-1]))[2]
