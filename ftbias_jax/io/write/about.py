"""What a file says about its arrays beside them: units, sign, frame, contacts, and what they were made from."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from ftbias_jax.io.write.fields import FIELDS, SIGN
from ftbias_jax.io.write.provenance import Provenance
from ftbias_jax.io.write.selection import ALL, Selection

SCHEMA = 1
SENSOR = "the sensor frame of the setup"


class About(NamedTuple):
    """What is to be said about a result beside its arrays."""

    frame: str = ""
    """The sensor's frame, as a recording of ROS names it; "" = not known."""
    origin: Provenance | None = None
    """What it was made from."""
    contacts: Sequence[Mapping[str, Any]] = ()
    """Intervals of contact, plain numbers."""
    selection: Selection = ALL
    """What of the result was written."""


def description(names: Iterable[str], about: About) -> dict[str, Any]:
    """Plain dicts for JSON."""
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


def description_text(names: Iterable[str], about: About) -> str:
    """JSON on one line."""
    return json.dumps(description(names, about), allow_nan=False)
