"""All withheld kinds: two for every drive of a description, one of them unseen until the end."""

from __future__ import annotations

from validation.generator.kinds.forces import FORCES
from validation.generator.kinds.kind import Kind
from validation.generator.kinds.readings import READINGS

KINDS: dict[str, Kind] = FORCES | READINGS
"""Name -> kind; no name is one of the package's catalogue or of the other unlisted effects."""


def chosen(which: str) -> list[str]:
    """Names of the kinds that are "seen", "unseen" or "all"."""
    return [name for name, kind in KINDS.items() if which == "all" or kind.unseen == (which == "unseen")]
