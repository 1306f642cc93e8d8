"""Selection of the arrays of a result, their precision and their samples; and the metadata of a file."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.errors import UsageError, is_integer, is_number
from ftbias_jax.io.write.fields import ADAPT, FIELDS, SIGN, SMOOTH
from ftbias_jax.io.write.provenance import Provenance, as_text
from ftbias_jax.setup.fields import nearest
from ftbias_jax.types import Array

PRECISIONS = {"single": np.float32, "double": np.float64}
"""Single has seven digits, some ten thousand times finer than a sensor's noise."""
ALWAYS_DOUBLE = ("t", "log_likelihood")
"""Fields that are always double, because seconds since 1970 have sixteen digits."""
EARLY = 0.1
"""Share of the output's period by which a sample may come before its time, because stamps jitter."""
SCHEMA = 1
SENSOR = "the sensor frame of the setup"


class Selection(NamedTuple):
    """Part of a result that is written. Samples are left out, never averaged: values are those of the samples kept."""

    fields: tuple[str, ...] = ()
    """Names of ``FIELDS``, to which t is added; () = all."""
    precision: str = "single"
    """Key of PRECISIONS; t and the log likelihood are double in any case."""
    every: int = 1
    """Keep one in this many samples, starting with the first."""
    rate: float | None = None
    """Hz, instead of ``every``: keep the first sample at or after each tick of a clock starting at the first one."""


ALL = Selection()


def names_of(fields: str | Sequence[str]) -> tuple[str, ...]:
    """Fields as a sequence; a single name is one field, not its letters."""
    return (fields,) if isinstance(fields, str) else tuple(fields)


def check_selection(selection: Selection, *, smooth: bool | None = None, adapt: bool | None = None) -> None:
    """Refuse an invalid selection, before minutes are spent on computing.

    ``smooth`` and ``adapt``: whether the result will be smoothed, and the noise estimated from the log; None = unknown.
    """
    there = {SMOOTH: smooth, ADAPT: adapt}
    for name in selection.fields:
        if name not in FIELDS:
            raise UsageError(f"there is no field {name!r}", field="fields", remedy=nearest(name, FIELDS))
        if there.get(FIELDS[name].needs) is False:
            remedy = "add --smooth" if FIELDS[name].needs == SMOOTH else "leave out --as-stated and adapt = false"
            raise UsageError(f"{name!r} will not be in the result", field="fields", remedy=remedy)
    if selection.precision not in PRECISIONS:
        message = f"{selection.precision!r} is no precision"
        raise UsageError(message, field="precision", remedy=f"choose from {', '.join(PRECISIONS)}")
    if not is_integer(selection.every) or selection.every < 1:
        raise UsageError(f"{selection.every} samples", field="every", remedy="give a whole number from 1 on")
    if selection.rate is not None and not is_number(selection.rate):
        raise UsageError(f"{selection.rate} Hz", field="rate", remedy="give a positive number")
    if selection.rate is not None and selection.every > 1:
        raise UsageError("every and a rate were both given", field="every", remedy="leave out one of the two")


def selected(arrays: Mapping[str, Array], selection: Selection = ALL) -> dict[str, Array]:
    """Selected arrays of a whole result: (T, ...) each with t (T,), or ()."""
    (whole,) = selected_parts([arrays], selection)
    return whole


def selected_parts(parts: Iterable[Mapping[str, Array]], selection: Selection) -> Iterator[dict[str, Array]]:
    """Selected arrays, part by part of a result; the selection does not depend on where a part ends."""
    check_selection(selection)
    wanted = PRECISIONS[selection.precision]
    count, first, tick = 0, 0.0, -np.inf
    for part in parts:
        t = np.asarray(part["t"])
        if missing := [name for name in selection.fields if name not in part]:
            remedy = "smooth the log" if FIELDS[missing[0]].needs == SMOOTH else "filter it without as_stated"
            raise UsageError(f"the result has no {missing[0]!r}", field="fields", remedy=remedy)
        if count == 0 and len(t):
            first = float(t[0])
        if selection.rate is None:
            rows = (count + np.arange(len(t))) % selection.every == 0
        else:
            ticks = np.floor((t - first) * selection.rate + EARLY)
            rows = np.diff(ticks, prepend=tick) > 0
            tick = ticks[-1] if len(t) else tick
        count += len(t)
        kept = {name: np.asarray(part[name]) for name in part if name in ("t", *(selection.fields or part))}
        kept |= {
            name: values.astype(wanted)
            for name, values in kept.items()
            if values.dtype.kind == "f" and name not in ALWAYS_DOUBLE
        }
        yield {name: values[rows] if values.ndim else values for name, values in kept.items()}


class About(NamedTuple):
    """Metadata of a result."""

    frame: str = ""
    """Frame of the sensor as named in a ROS recording; "" = unknown."""
    origin: Provenance | None = None
    """Provenance of the result."""
    contacts: Sequence[Mapping[str, Any]] = ()
    """Intervals of contact, in plain numbers."""
    selection: Selection = ALL
    """Part of the result that was written."""


def description(names: Iterable[str], about: About) -> dict[str, Any]:
    """Metadata of the arrays ``names`` as plain dicts for JSON."""
    selection = about.selection
    return {
        "schema": SCHEMA,
        "sign": SIGN,
        "frame": about.frame or SENSOR,
        "fields": {
            name: {"unit": FIELDS[name].unit, "meaning": FIELDS[name].meaning} for name in names if name in FIELDS
        },
        "precision": selection.precision,
        "every": selection.every,
        "rate": selection.rate,
        "contacts": list(about.contacts),
    }


def texts_of(names: Iterable[str], about: About) -> dict[str, str]:
    """Metadata as JSON on one line each: ``about`` with units, sign and frame, and ``provenance`` if it is known."""
    texts = {"about": json.dumps(description(names, about), allow_nan=False)}
    return texts if about.origin is None else texts | {"provenance": as_text(about.origin)}
