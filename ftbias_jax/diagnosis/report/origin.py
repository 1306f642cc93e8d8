"""Where a diagnosis comes from, in words for the report."""

from __future__ import annotations

from datetime import UTC, datetime
from importlib.metadata import version
from platform import python_version

from ftbias_jax import __version__
from ftbias_jax.diagnosis.result import Diagnosis


def versions() -> str:
    """Of all that numbers depend on."""
    others = ", ".join(f"{name} {version(name)}" for name in ("jax", "jaxlib", "numpy"))
    return f"ftbias_jax {__version__}, {others}, Python {python_version()}"


def origin_rows(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """(what, value) of the provenance: one file a row, and what holds for all."""
    origin = diagnosis.provenance
    if origin is None:
        return []
    rows = [("made at", datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z"))]
    rows += [("command", diagnosis.command)] if diagnosis.command else []
    rows += [("versions", versions()), ("robot", origin["robot"])]
    for kind, file in (("setup", origin["setup"]), ("URDF", origin["urdf"])):
        rows += [(f"{kind} {file['name']}", f"SHA-256 {file['sha256']}")] if file else []
    for log in origin["logs"]:
        measured = f"{log['samples']} samples of the wrench in {log['duration']:.6g} s, {log['rate'] or 0:.4g} Hz"
        known = [log["date"], measured, f"SHA-256 {log['sha256']}" if log["sha256"] else "from memory"]
        rows.append((f"log {log['name']}", ", ".join(filter(None, known))))
    options = ", ".join(f"{name} = {value}" for name, value in origin["options"].items() if value)
    return [*rows, ("options", options)] if options else rows
