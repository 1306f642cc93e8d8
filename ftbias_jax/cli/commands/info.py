"""``ftbias info``: what is in a log, and what can be filtered from it."""

from __future__ import annotations

import argparse
import math
from datetime import UTC, datetime

from ftbias_jax.errors import LONGEST, cut
from ftbias_jax.io.info import LogInfo, StreamInfo, describe
from ftbias_jax.setup import load_setup

MAX_LISTED = 8


def run(arguments: argparse.Namespace) -> int:
    """Print what is there; returns 3 if a part could not be read, else 0."""
    setup = None if arguments.setup is None else load_setup(arguments.setup, allow_outside=arguments.allow_outside)
    info = describe(arguments.log, setup, salvage=True)
    print(format_info(arguments.log, info))
    return 3 if any(repair.lost for repair in info.repairs) else 0


def format_info(file: str, info: LogInfo) -> str:
    """The log on a page, one paragraph a stream; names from the log cannot disturb a terminal."""
    lines = [line for stream in info.streams for line in _stream_lines(stream)]
    if info.topics:
        lines.append("other topics: " + _listed([f"{cut(topic.name)} ({topic.messages})" for topic in info.topics]))
    if info.others:
        lines.append("other columns: " + ", ".join(map(cut, info.others)))
    lines += [f"repaired: {repair.what}" for repair in info.repairs]
    if info.keys:
        lines += ["a setup that reads it states, by its names and numbers:", *(f"  {line}" for line in info.keys)]
    lines.append(f"{cut(file)}: {info.verdict}")
    return "\n".join("".join(c if c.isprintable() else "?" for c in cut(line, LONGEST)) for line in lines)


def _stream_lines(stream: StreamInfo) -> list[str]:
    lines = [f"{cut(stream.name)}: {stream.kind}, {stream.samples} samples"]
    if stream.samples > 1:
        seconds = stream.last - stream.first
        timed = not math.isnan(stream.rate)
        lines[0] += f", {stream.rate:.4g} Hz, {seconds:.6g} s from {_moment(stream.first)}" if timed else ""
    if any(stream.names):
        lines.append(f"  {'joints' if len(stream.names) > 1 else 'of'}: {', '.join(map(cut, stream.names))}")
    if stream.gaps:
        longest = sorted(stream.gaps, key=lambda gap: -gap[1])
        lines.append("  gaps: " + _listed([f"{length:.4g} s at {at:.6g} s" for at, length in longest]))
    return [*lines, *(f"  {trouble}" for trouble in stream.trouble)]


def _moment(seconds: float) -> str:
    """A stamp as a date, if it can be one: seconds since 1970, after the year 2000."""
    if not 946684800 < seconds < 4102444800:
        return f"{seconds:.6g} s"
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _listed(words: list[str]) -> str:
    more = f" and {len(words) - MAX_LISTED} more" if len(words) > MAX_LISTED else ""
    return ", ".join(words[:MAX_LISTED]) + more
