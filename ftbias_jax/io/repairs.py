"""What a reader had to mend or leave out, so that it can be told."""

from __future__ import annotations

from typing import NamedTuple

from ftbias_jax.types import Log


class Repair(NamedTuple):
    """One kind of repair, or a fact the owner should know."""

    what: str
    """One line that names the stream and the count."""
    lost: bool = False
    """Whether samples of the log were left out."""


Repairs = tuple[Repair, ...]


class Reading(NamedTuple):
    """A log and what was repaired to read it."""

    log: Log
    repairs: Repairs
