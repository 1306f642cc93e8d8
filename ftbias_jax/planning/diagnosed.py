"""Input of a plan from a diagnosis: the sizes of effects, and the two that it could not distinguish."""

import os
from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

from ftbias_jax.errors import UsageError
from ftbias_jax.io.atomic import read_json
from ftbias_jax.model.effects.catalogue import Catalogue, check_values
from ftbias_jax.model.effects.types import Values

WANTED = "what ftbias diagnose --json wrote"


class Diagnosed(NamedTuple):
    """Effects that a diagnosis reports."""

    values: Values
    twins: str
    """The first cause and the first effect that it could not be distinguished from, as A:B; "" = there is none."""


def read_diagnosis(path: str | os.PathLike[str], catalogue: Catalogue) -> Diagnosed:
    """Read causes and candidates from a file of ``Diagnosis.to_json``; effects with invalid values are skipped.

    Raises:
        UsageError: the file cannot be read, or is no diagnosis.
    """
    file = os.fspath(path)
    content = read_json(file, WANTED, UsageError)
    causes = content.get("causes") if isinstance(content, Mapping) else None
    if not isinstance(causes, list):
        raise UsageError("has no list of causes", file=file, remedy=f"give {WANTED}")
    entries = [x for x in (*causes, *_list(content.get("candidates"))) if isinstance(x, Mapping)]
    named = [x for x in entries if isinstance(x.get("effect"), str) and x["effect"] in catalogue]
    values: Values = {}
    for one in reversed(named):  # the first entry of a name is the best, and is kept
        effect, stated = one["effect"], one.get("parameters")
        known = {parameter.name for parameter in catalogue[effect].parameters}
        if isinstance(stated, Mapping):
            mine = {effect: {key: value for key, value in stated.items() if key in known}}
            try:
                values |= check_values(mine, partial(UsageError, file=file), catalogue=catalogue)
            except UsageError:
                continue  # a share of the whole, or a value out of bounds: the plan then uses a typical value
    for one in named[: len(causes)]:
        others = [x for x in _list(one.get("indistinguishable_from")) if isinstance(x, str) and x in catalogue]
        if others:
            return Diagnosed(values, f"{one['effect']}:{others[0]}")
    return Diagnosed(values, "")


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []
