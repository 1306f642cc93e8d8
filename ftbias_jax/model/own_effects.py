"""Effects that the caller brings: from a Python file, from an installed package, or made in a program.

Loading runs code, so it happens only where the caller asks for it; no setup and no log can name what is run.
"""

from __future__ import annotations

import importlib.util
import keyword
import os
import traceback
from collections.abc import Iterable, Sequence
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ftbias_jax.errors import FtbiasError, UsageError
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.model.effects.fitting import (
    SIGNS,
    ByJoint,
    Entries,
    Fitting,
    Grid,
    Linear,
    Samples,
    Search,
    Settling,
    Starts,
    Step,
)
from ftbias_jax.model.effects.table import Catalogue
from ftbias_jax.model.effects.terms.parse import NAME as TERM
from ftbias_jax.model.effects.types import Effect, Parameter
from ftbias_jax.setup.types import Setup

GROUP = "ftbias_jax.effects"
"""Entry points of packages that bring effects: each names an ``Effect`` or several."""
STAGES = tuple(dict.fromkeys(effect.stage for effect in CATALOGUE.values()))


def catalogue_of_setup(setup: Setup) -> Catalogue:
    """The built-in effects and those that the setup's caller has brought.

    Raises:
        UsageError: one of these is no entry of a catalogue: two of a name, an unknown stage, nothing that acts.
    """
    return catalogue_with(setup.own_effects)


def catalogue_with(own: Sequence[Any]) -> Catalogue:
    """The built-in effects and further ones.

    Raises:
        UsageError: as ``catalogue_of_setup``.
    """
    known = {*CATALOGUE, TERM}
    for effect in own:
        fault = fault_of(effect, known)
        if fault:
            raise UsageError(fault, field="effects", remedy="see `ftbias effects check FILE`")
        known.add(effect.name)
    return CATALOGUE.adding(own) if own else CATALOGUE


def load_effects(source: str | os.PathLike[str]) -> tuple[Effect, ...]:
    """Effects of a Python file, or of an installed package that offers them by the entry point ``ftbias_jax.effects``.

    Args:
        source: a path that ends in .py, or the name of an entry point.

    Returns:
        every ``Effect`` that the file names, or those of its ``EFFECTS`` if it has such a list, in their order.

    Raises:
        UsageError: nothing is there, the code fails, or it holds no effect.
    """
    name = os.fspath(source)
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
    """Effects of several sources, each run once by a process: what was compiled for them is then used again."""
    return tuple(effect for source in sources for effect in load_effects(source))


def installed() -> tuple[EntryPoint, ...]:
    """What installed packages offer; nothing of it is run."""
    return tuple(entry_points(group=GROUP))


def _entries_of(found: Any) -> tuple[Effect, ...]:
    items: Iterable[Any] = (found,) if isinstance(found, Effect) else found
    unique = {id(item): item for item in items if isinstance(item, Effect)}
    return tuple(unique.values())


def _module_of(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"_effects_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _run(name: str, load: Any) -> Any:
    try:
        return load()
    except FtbiasError:
        raise
    except Exception as error:  # the caller's code: whatever it raises is told with its line
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(name)]
        line = getattr(error, "lineno", None) or (lines[-1] if lines else None)
        where = f"line {line}" if line else ""
        message = f"{type(error).__name__}: {error}"
        raise UsageError(message, file=name, field=where, remedy="correct the code") from error


def fault_of(effect: Any, known: Iterable[str] = CATALOGUE) -> str:
    """What keeps an object from being an entry of a catalogue, in a sentence; "" = nothing that can be seen of it.

    Args:
        effect: the object.
        known: names that are taken.
    """
    if not isinstance(effect, Effect):
        return f"expected an Effect, got {type(effect).__name__}"
    if not _is_key(effect.name):
        return f"effect {effect.name!r}: a name has letters, digits and underscores"
    who = f"effect {effect.name!r}"
    if effect.name in set(known):
        return f"{who}: the name is taken; choose another one"
    if effect.stage not in STAGES:
        return f"{who}: stage {effect.stage!r} is none of {', '.join(STAGES)}"
    if effect.needs_motion not in ("", "joints", "acceleration"):
        return f"{who}: needs_motion {effect.needs_motion!r} is neither joints nor acceleration"
    if not any((effect.transform, effect.reading, effect.recording)):
        return f"{who}: give it a reading, a transform or a recording, or it does nothing"
    if effect.recording and (effect.transform or effect.reading):
        return f"{who}: a recording acts alone; make the reading or transform an effect of its own"
    if any(effect.filter_noise == other.filter_noise != "" for other in CATALOGUE.values()):
        return f"{who}: filter_noise is for built-in effects; use widen"
    fault = next((fault for fault in map(_fault_of_parameter, effect.parameters) if fault), "")
    fault = fault or fault_of_fit(effect)
    if not fault and len({parameter.name for parameter in effect.parameters}) < len(effect.parameters):
        fault = "two parameters have one name"
    return f"{who}: {fault}" if fault else ""


def fault_of_fit(effect: Effect) -> str:
    """What is wrong with what an effect says about its fit: a parameter that it does not have, samples or no samples.

    Args:
        effect: an entry of a catalogue.
    """
    fit: Any = effect.fit
    if not isinstance(fit, Fitting):
        return f"fit: expected a Fitting, got {type(fit).__name__}"
    search = fit.search
    if isinstance(search, Samples):
        if not effect.recording:
            return "fit: what is read off samples must have a recording"
        return "" if search.sign in SIGNS else f"fit: the sign {search.sign!r} is none of {', '.join(SIGNS)}"
    if effect.recording and not isinstance(search, Starts):
        return "fit: a recording is read off samples, by Samples(...), or not at all"
    roles = [role for role in search if isinstance(role, str) and role]
    if isinstance(search, Linear):
        roles = [name for variant in search.variants for name, _ in variant]
    known = {parameter.name for parameter in effect.parameters}
    missing = next((f"fit: there is no parameter {role!r}" for role in roles if role not in known), "")
    return missing or _fault_of_search(effect, search)


def _fault_of_search(effect: Effect, search: Search) -> str:
    """What a search needs of the parameters beside their names."""
    strengths = [p.shape for p in effect.parameters if not p.search and np.any(np.asarray(p.scale, float) > 0)]
    match search:
        case Settling() | Step() if strengths != [(6,)]:
            return "fit: a series needs one parameter without search, its strength in each of the six channels"
        case Settling(time) if not effect.parameter(time).starts:
            return f"fit: parameter {time!r} needs starts"
        case Grid() if not any(parameter.starts for parameter in effect.parameters):
            return "fit: a grid needs a parameter with starts"
        case Entries(matrix) if effect.parameter(matrix).shape != (6, 6):
            return f"fit: parameter {matrix!r} is no matrix (6, 6)"
        case Starts(when) if when and (effect.parameter(when).shape or not effect.parameter(when).search):
            return f"fit: the time {when!r} must be one number with search=True"
        case ByJoint() if not effect.transform:
            return "fit: what moves a joint must have a transform"
    return ""


def _is_key(name: Any) -> bool:
    return isinstance(name, str) and name.isidentifier() and name.isascii() and not keyword.iskeyword(name)


def _fault_of_parameter(parameter: Any) -> str:
    if not isinstance(parameter, Parameter):
        return f"expected a Parameter, got {type(parameter).__name__}"
    who = f"parameter {parameter.name!r}"
    if not _is_key(parameter.name):
        return f"{who}: a name has letters, digits and underscores"
    shape = tuple(max(size, 1) for size in parameter.shape)
    numbers = {"lower": parameter.lower, "upper": parameter.upper, "scale": parameter.scale}
    if not callable(parameter.neutral):
        numbers["neutral"] = parameter.neutral
    for word, value in numbers.items():
        try:
            array = np.broadcast_to(np.asarray(value, float), shape)
        except (TypeError, ValueError):
            return f"{who}: {word} does not fit the shape {parameter.shape}"
        if np.isnan(array).any():
            return f"{who}: {word} is not a number"
    scale = np.asarray(parameter.scale, float)
    if (scale < 0).any() or not np.isfinite(scale).all():
        return f"{who}: scale, the size of a typical departure from neutral, must be 0 or more"
    if not np.all(np.asarray(parameter.lower, float) <= np.asarray(parameter.upper, float)):
        return f"{who}: lower is above upper"
    if "neutral" in numbers:
        neutral = np.asarray(numbers["neutral"], float)
        if not np.all((neutral >= parameter.lower) & (neutral <= parameter.upper)):
            return f"{who}: neutral is outside of its bounds"
        if not np.isfinite(neutral).all() and not parameter.search:
            return f"{who}: an infinite neutral needs search=True, because nothing can be linearised there"
    for start in parameter.starts:
        if np.shape(start) not in (parameter.shape, ()):
            return f"{who}: the start {start!r} does not have the shape {parameter.shape}"
    return ""
