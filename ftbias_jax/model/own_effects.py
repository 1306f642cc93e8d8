"""User-defined effects: from a Python file, from an installed package, or made in a program.

Loading runs code, so it happens only where the caller asks for it; no setup and no log can name code to run. This
module also determines which effects are observable in a setup's logs: some act on the joints of an arm.
"""

import importlib.util
import keyword
import os
import traceback
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ftbias_jax.errors import FtbiasError, SetupError, UsageError, is_integer, path_of
from ftbias_jax.model.effects import fitting
from ftbias_jax.model.effects.catalogue import CATALOGUE, Catalogue
from ftbias_jax.model.effects.terms.parse import TERM, MakeError
from ftbias_jax.model.effects.types import Effect, Parameter
from ftbias_jax.setup.types import Setup

GROUP = "ftbias_jax.effects"
"""Entry point group of packages that provide effects; each entry point names one ``Effect`` or several."""
STAGES = tuple(dict.fromkeys(effect.stage for effect in CATALOGUE.values()))


def catalogue_of_setup(setup: Setup) -> Catalogue:
    """Catalogue of the built-in effects and the user-defined effects of a setup.

    Raises:
        UsageError: a user-defined effect is not a valid entry: duplicate name, unknown stage, or no function that acts.
    """
    return catalogue_with(setup.own_effects)


def catalogue_with(own: Sequence[Any]) -> Catalogue:
    """Catalogue of the built-in effects and the given ones.

    Raises:
        UsageError: as for ``catalogue_of_setup``.
    """
    known = {*CATALOGUE, TERM}
    for effect in own:
        fault = fault_of(effect, known)
        if fault:
            raise UsageError(fault, field="effects", remedy="see `ftbias effects check FILE`")
        known.add(effect.name)
    return CATALOGUE.adding(own) if own else CATALOGUE


def load_effects(source: str | os.PathLike[str]) -> tuple[Effect, ...]:
    """Load effects from a Python file, or from an installed package with the entry point ``ftbias_jax.effects``.

    Args:
        source: a path that ends in .py, or the name of an entry point.

    Returns:
        every ``Effect`` at the top level of the file, or those in its list ``EFFECTS`` if it has one, in their order.

    Raises:
        UsageError: the source does not exist, its code fails, or it defines no effect.
    """
    name = path_of(source, "effects")
    offered = {entry.name: entry for entry in installed()}
    if name in offered and not Path(name).exists():
        found = _entries_of(_run(name, offered[name].load))
    elif Path(name).is_file():
        module = _run(name, lambda: _module_of(Path(name)))
        found = _entries_of(getattr(module, "EFFECTS", list(vars(module).values())))
    else:
        names = f", or one of the installed {', '.join(offered)}" if offered else ""
        raise UsageError("is no file", file=name, field="--effects", remedy=f"give a Python file with effects{names}")
    if not found:
        remedy = "write NAME = Effect(...) at its top level, or EFFECTS = (...)"
        raise UsageError("defines no effect", file=name, remedy=remedy)
    return found


@lru_cache
def load_all(sources: tuple[str, ...]) -> tuple[Effect, ...]:
    """Load effects from several sources, each run once per process, so that functions compiled for them are reused."""
    return tuple(effect for source in sources for effect in load_effects(source))


def installed() -> tuple[EntryPoint, ...]:
    """Entry points of installed packages that provide effects; none of their code is run."""
    return tuple(entry_points(group=GROUP))


def _entries_of(found: Any) -> tuple[Effect, ...]:
    items: Iterable[Any] = (found,) if isinstance(found, Effect) else found
    unique = {id(item): item for item in items if isinstance(item, Effect)}
    return tuple(unique.values())


def _module_of(path: Path) -> ModuleType:
    spec: Any = importlib.util.spec_from_file_location(f"_effects_{path.stem}", path)
    module: ModuleType = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _run(name: str, load: Any) -> Any:
    try:
        return load()
    except FtbiasError:
        raise
    except Exception as error:  # The code is the caller's, so whatever it raises is reported with its line.
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(name)]
        line = getattr(error, "lineno", None) or (lines[-1] if lines else None)
        where = f"line {line}" if line else ""
        message = f"{type(error).__name__}: {error}"
        raise UsageError(message, file=name, field=where, remedy="correct the code") from error


def fault_of(effect: Any, known: Iterable[str] = CATALOGUE) -> str:
    """Reason, as a sentence, why an object is no valid entry beside the known names; "" = no fault was found."""
    if not isinstance(effect, Effect):
        return f"expected an Effect, got {type(effect).__name__}"
    return next((f"effect {effect.name!r}: {fault}" for fault in _faults(effect, set(known))), "")


def _faults(effect: Effect, known: set[str]) -> Iterator[str]:
    """Faults of an effect, in order; a check may assume that all checks before it found no fault."""
    if not _is_key(effect.name):
        yield "a name has letters, digits and underscores"
    if effect.name in known:
        yield "the name is taken; choose another one"
    if effect.stage not in STAGES:
        yield f"stage {effect.stage!r} is none of {', '.join(STAGES)}"
    if effect.needs_motion not in ("", "joints", "acceleration"):
        yield f"needs_motion {effect.needs_motion!r} is neither joints nor acceleration"
    if not any((effect.transform, effect.reading, effect.recording)):
        yield "give it at least one of reading, transform and recording"
    for what in ("parameters", "needs", "twins"):
        if not isinstance(getattr(effect, what), tuple | list):
            yield f"{what} must be a tuple, not {getattr(effect, what)!r}"
    if effect.recording and (effect.transform or effect.reading):
        yield "recording cannot be combined with reading or transform; define two effects"
    if any(effect.filter_noise == other.filter_noise != "" for other in CATALOGUE.values()):
        yield "filter_noise is for built-in effects; use widen"
    parameters: Any = effect.parameters
    for parameter in parameters:
        if not isinstance(parameter, Parameter):
            yield f"expected a Parameter, got {type(parameter).__name__}"
        yield from (f"parameter {parameter.name!r}: {fault}" for fault in _faults_of_parameter(parameter))
    yield from (f"fit: {fault}" for fault in _faults_of_fit(effect))
    if len({parameter.name for parameter in parameters}) < len(parameters):
        yield "two parameters have one name"


def _faults_of_fit(effect: Effect) -> Iterator[str]:
    """Faults of the ``fit`` entry of an effect, in order."""
    fit: Any = effect.fit
    if not isinstance(fit, fitting.Fitting):
        yield f"expected a Fitting, got {type(fit).__name__}"
    search = fit.search
    if isinstance(search, fitting.Samples):
        if not effect.recording:
            yield "an effect with search=Samples(...) needs a recording function"
        if search.sign not in fitting.SIGNS:
            yield f"the sign {search.sign!r} is none of {', '.join(fitting.SIGNS)}"
        return
    if effect.recording and not isinstance(search, fitting.Starts):
        yield "a recording is read off samples, by Samples(...), or not at all"
    roles = [role for role in search if isinstance(role, str) and role]
    if isinstance(search, fitting.Linear):
        roles = [name for variant in search.variants for name, _ in variant]
    known = {parameter.name for parameter in effect.parameters}
    yield from (f"there is no parameter {role!r}" for role in roles if role not in known)
    strengths = [p.shape for p in effect.parameters if not p.search and np.any(np.asarray(p.scale, float) > 0)]
    match search:
        case fitting.Settling() | fitting.Step() if strengths != [(6,)]:
            yield "a series needs one parameter without search, its strength in each of the six channels"
        case fitting.Settling(time) if not effect.parameter(time).starts:
            yield f"parameter {time!r} needs starts"
        case fitting.Grid() if not any(parameter.starts for parameter in effect.parameters):
            yield "a grid needs a parameter with starts"
        case fitting.Entries(matrix) if effect.parameter(matrix).shape != (6, 6):
            yield f"parameter {matrix!r} is no matrix (6, 6)"
        case fitting.ByJoint() if not effect.transform:
            yield "an effect with search=ByJoint(...) needs a transform function"


def _faults_of_parameter(parameter: Any) -> Iterator[str]:
    if not _is_key(parameter.name):
        yield "a name has letters, digits and underscores"
    if not isinstance(parameter.shape, tuple) or not all(is_integer(size) for size in parameter.shape):
        yield f"shape must be a tuple of integers, such as (3,), not {parameter.shape!r}"
    if not isinstance(parameter.starts, tuple | list):
        yield f"starts must be a tuple, such as (1.0,), not {parameter.starts!r}"
    shape = tuple(max(size, 1) for size in parameter.shape)
    numbers = {}
    for word in ("lower", "upper", "scale", "neutral"):
        if callable(value := getattr(parameter, word)):
            continue
        try:
            numbers[word] = np.broadcast_to(np.asarray(value, float), shape)
        except (TypeError, ValueError):
            yield f"{word} does not fit the shape {parameter.shape}"
        if np.isnan(numbers[word]).any():
            yield f"{word} is not a number"
    if not ((numbers["scale"] >= 0) & np.isfinite(numbers["scale"])).all():
        yield "scale, the size of a typical departure from neutral, must be 0 or more"
    if not (numbers["lower"] <= numbers["upper"]).all():
        yield "lower is above upper"
    if "neutral" in numbers:
        neutral = numbers["neutral"]
        if not ((neutral >= numbers["lower"]) & (neutral <= numbers["upper"])).all():
            yield "neutral is outside of its bounds"
        if not np.isfinite(neutral).all() and not parameter.search:
            yield "an infinite neutral needs search=True, because nothing can be linearised there"
    for start in parameter.starts:
        if np.shape(start) not in (parameter.shape, ()):
            yield f"the start {start!r} does not have the shape {parameter.shape}"


def _is_key(name: Any) -> bool:
    return isinstance(name, str) and name.isidentifier() and name.isascii() and not keyword.iskeyword(name)


OF_JOINTS = "it acts on the joints of an arm, but the sensor's pose is recorded instead"
OF_ACCELERATION = "the sensor's acceleration is not recorded"


def unobservable_effects(setup: Setup) -> dict[str, str]:
    """Effects that are unobservable in any log of this setup: name -> reason."""
    if setup.pose is None:
        return {}
    why = {"joints": OF_JOINTS} | ({"acceleration": OF_ACCELERATION} if setup.pose.linear == "none" else {})
    needed = {name: effect.needs_motion for name, effect in catalogue_of_setup(setup).items()}
    return {name: why[motion] for name, motion in needed.items() if motion in why}


def check_observable(effects: Mapping[str, Any], setup: Setup, error: MakeError = SetupError, prefix: str = "") -> None:
    """Raise an error for effects, name -> values as written, that are unobservable in any log of this setup."""
    reasons = unobservable_effects(setup)
    of_terms = [section for section in effects.get(TERM, ()) if isinstance(section, Mapping)]
    if setup.pose is not None and any("joint" in f"{s.get('drive')} {s.get('frame')}" for s in of_terms):
        reasons[TERM] = OF_JOINTS
    for name in effects:
        if name in reasons:
            message = f"does not go with [sensor_pose]: {reasons[name]}"
            raise error(message, field=f"{prefix}{name}", remedy="remove it, or record the joints")
