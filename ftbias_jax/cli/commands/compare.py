"""``ftbias compare``: what differs between two setups, two results, or two diagnoses or checks."""

import argparse
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ftbias_jax.errors import UsageError, printable
from ftbias_jax.io.atomic import read_json
from ftbias_jax.setup import load_setup
from ftbias_jax.setup.dump import lines_of, toml_value

MOST = 200
"""Maximum number of differences that are printed."""


def run(arguments: argparse.Namespace) -> int:
    """Print the differences; returns 1 if there are any, else 0."""
    one, two = arguments.one, arguments.two
    suffixes = {Path(path).suffix.lower() for path in (one, two)}
    compare = {".toml": _setups, ".npz": _results, ".json": _documents}.get(suffixes.pop())
    if suffixes or compare is None:
        remedy = "give two setups (.toml), two results (.npz), or two diagnoses or checks (.json)"
        raise UsageError(f"{one!r} and {two!r} cannot be compared", field="FILE", remedy=remedy)
    found = list(compare(one, two))
    for line in found[:MOST]:
        print(printable(line))
    if len(found) > MOST:
        print(f"and {len(found) - MOST} more")
    if not found:
        print("no difference")
    return 1 if found else 0


def _setups(one: str, two: str) -> Iterator[str]:
    """Keys whose values differ, whatever the layout of the files."""
    said = [
        {f"{line.section} {line.key}": toml_value(line.value) for line in lines_of(load_setup(path)) if line.key}
        for path in (one, two)
    ]
    yield from _differences(*said)


def _differences(one: Mapping[str, str], two: Mapping[str, str]) -> Iterator[str]:
    for key in dict.fromkeys((*one, *two)):
        before, after = one.get(key, "not stated"), two.get(key, "not stated")
        if before != after:
            yield f"{key}: {before} -> {after}"


def _documents(one: str, two: str) -> Iterator[str]:
    """Values that differ at the same place in two JSON files."""
    yield from _differences(*(dict(_leaves(read_json(path, "a diagnosis or a check"), "")) for path in (one, two)))


def _leaves(value: Any, place: str) -> Iterator[tuple[str, str]]:
    match value:
        case dict():
            for key, item in value.items():
                yield from _leaves(item, f"{place}.{key}" if place else str(key))
        case list():
            for i, item in enumerate(value):
                yield from _leaves(item, f"{place}[{i}]")
        case float():
            yield place, f"{value:.6g}"
        case _:
            yield place, json.dumps(value)


def _results(one: str, two: str) -> Iterator[str]:
    """Arrays of two results that differ, with the root mean square and the maximum of the difference."""
    from ftbias_jax.io.write.npz import load_npz

    first, second = load_npz(one), load_npz(two)
    for name in dict.fromkeys((*first, *second)):
        if name not in first or name not in second:
            yield f"{name}: only in {one if name in first else two}"
            continue
        a, b = np.asarray(first[name]), np.asarray(second[name])
        if a.shape != b.shape:
            yield f"{name}: shape {a.shape} -> {b.shape}"
        elif a.dtype.kind not in "fiub" or b.dtype.kind not in "fiub":
            if not np.array_equal(a, b):
                yield f"{name}: differs"
        elif not np.array_equal(a, b, equal_nan=True):
            apart = np.abs(a.astype(float) - b.astype(float))
            apart = apart[np.isfinite(apart)]
            rms, most = (np.sqrt((apart**2).mean()), apart.max()) if apart.size else (np.nan, np.nan)
            yield f"{name}: differs by {rms:.3g} rms, {most:.3g} at most"
