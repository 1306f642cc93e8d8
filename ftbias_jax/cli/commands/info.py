"""``ftbias info``: contents of a log, and whether it can be filtered."""

import argparse
import math
import shlex
from datetime import UTC, datetime

from ftbias_jax.errors import LONGEST, cut, printable
from ftbias_jax.filtering.quality.at_rest import rest_in_words
from ftbias_jax.io.cleaning import slices
from ftbias_jax.io.health import StreamInfo
from ftbias_jax.io.info import LogInfo, describe
from ftbias_jax.setup import load_setup
from ftbias_jax.setup.require import has_no_tool, is_draft
from ftbias_jax.setup.types import Setup

MAX_LISTED = 8


def run(arguments: argparse.Namespace) -> int:
    """Print the contents of a log; returns 3 if a part could not be read, else 0."""
    setup = None if arguments.setup is None else load_setup(arguments.setup, allow_outside=arguments.allow_outside)
    info = describe(arguments.log, setup, salvage=True)
    print(format_info(arguments.log, info))
    rests = rest_in_words(setup, slices(info.log)) if setup and info.log else ""
    for line in (rests, f"next: {_next(arguments, setup, info, rests)}"):
        print(printable(line), end="\n" if line else "")
    return 3 if any(repair.lost for repair in info.repairs) else 0


def _next(arguments: argparse.Namespace, setup: Setup | None, info: LogInfo, rests: str) -> str:
    """Command to run next."""
    log = shlex.quote(arguments.log)
    if setup is None:
        has_joints = any(stream.names or stream.name == "joints" for stream in info.streams)
        robot = " --robot NAME" if has_joints else ""
        rate = " --rate HZ" if any(line.startswith("rate = ...") for line in info.keys) else ""
        return f"ftbias setup {log}{robot}{rate} -o setup.toml" + (" (--list shows the names)" if robot else "")
    stated = f"{log} --setup {shlex.quote(arguments.setup)}"
    if info.poses:
        return f"ftbias identify {stated} -o identified.toml"
    if info.log is None:
        return f"correct the setup, then ftbias info {stated}"
    if not rests and not has_no_tool(setup) and (setup.tool.unknown or is_draft(setup)):
        return f"ftbias identify {stated} -o identified.toml"
    return f"ftbias filter {stated} -o result.npz" if rests else f"ftbias check {stated}"


def format_info(file: str, info: LogInfo) -> str:
    """Description of a log, one paragraph per stream; unprintable characters of its names are replaced."""
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
    """Stamp as a date if it is in the years 2000 to 2099 as seconds since 1970, else in seconds."""
    if not 946684800 < seconds < 4102444800:
        return f"{seconds:.6g} s"
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _listed(words: list[str]) -> str:
    more = f" and {len(words) - MAX_LISTED} more" if len(words) > MAX_LISTED else ""
    return ", ".join(words[:MAX_LISTED]) + more
