"""Results as MCAP files of geometry_msgs/msg/WrenchStamped, and layouts of viewers for their topics.

Foxglove and PlotJuggler plot the files without any setting; in a layout, what a file lacks stays empty. Foxglove: JSON
with a configuration for every panel (configById) and the tree of panels (layout), as its "Import from file" reads it
(foxglove/studio, packages/studio-base). PlotJuggler: XML of tabs, splitters and plots, as "Load layout" reads it
(facontidavide/PlotJuggler, plotjuggler_app).
"""

import json
import os
import struct
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from typing import Any, BinaryIO

import numpy as np

from ftbias_jax.errors import OutputError
from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.io.limits.budget import need
from ftbias_jax.io.write.fields import FIELDS, SIGN
from ftbias_jax.io.write.selection import About, texts_of
from ftbias_jax.types import Array

TOPICS = (
    *("wrench_unbiased", "bias", "bias_std", "bias_smooth", "wrench_tool", "innovation"),
    *("contact_wrench", "contact_wrench_std"),
)
"""Arrays (T, 6) that become the topic /ftbias/NAME, where they are there."""
FLAGS = ("used", "in_contact")
"""Arrays (T,) of truth values that do, as std_msgs/msg/Bool."""
FRAME = "ft_sensor"
"""Where the log names none."""

CDR = b"\x00\x01\x00\x00"
"""How a message begins: little endian."""


def schema_with_header(message: str, *parts: str) -> str:
    """The definition of a ROS 2 message with a header, and those of its other parts, each with its name first."""
    header = (
        "std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n",
        "builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
    )
    return ("=" * 80 + "\nMSG: ").join((message, *header, *parts))


SCHEMA = schema_with_header(
    f"# {SIGN}\nstd_msgs/Header header\nWrench wrench\n",
    "geometry_msgs/Wrench\nVector3 force  # N\nVector3 torque  # Nm, about the sensor's origin\n",
    "geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n",
)
FLAG_SCHEMA = "bool data\n"
COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf")
"""In the order of the lines of a plot."""


def save_mcap(path: str | os.PathLike[str], arrays: Mapping[str, Array], about: About) -> None:
    """Write the corrected wrench, the bias and what else is there as topics.

    Args:
        path: the file.
        arrays: t (T,) s by the log's clock, (T, 6) arrays of TOPICS, N and Nm, signs as in the report, and (T,) arrays
            of FLAGS.
        about: its frame is that of the headers. What it says is kept in the metadata record ``ftbias`` (``about``,
            ``provenance``); every channel has ``unit``, ``meaning`` and ``sign`` in its own metadata.
    """
    frame = about.frame or FRAME
    writers = need("mcap.writer", "ros", path, writes=True)
    stamps = np.rint(np.asarray(arrays["t"]) * 1e9).astype(np.int64)
    if not ((stamps >= 0) & (stamps < 2**32 * 10**9)).all():
        message = f"stamps from {stamps.min()} to {stamps.max()} ns do not fit a ROS header"
        raise OutputError(message, file=path, remedy="write another format, or stamp the log with times since 1970")
    topics = {name: np.asarray(arrays[name], np.float64) for name in TOPICS if name in arrays}
    flags = {name: np.asarray(arrays[name], bool) for name in FLAGS if name in arrays}

    def write(file: BinaryIO) -> None:
        writer = writers.Writer(file)
        writer.start(profile="ros2", library="ftbias_jax")
        schema = writer.register_schema("geometry_msgs/msg/WrenchStamped", "ros2msg", SCHEMA.encode())
        channels = {name: writer.register_channel(topic(name), "cdr", schema, _words(name)) for name in topics}
        if flags:
            schema = writer.register_schema("std_msgs/msg/Bool", "ros2msg", FLAG_SCHEMA.encode())
        channels |= {name: writer.register_channel(topic(name), "cdr", schema, _words(name)) for name in flags}
        for i, stamp in enumerate(stamps.tolist()):
            messages = {name: wrench_message(stamp, frame, wrenches[i]) for name, wrenches in topics.items()}
            messages |= {name: CDR + bytes([bool(truths[i])]) for name, truths in flags.items()}
            for name, message in messages.items():
                writer.add_message(channels[name], stamp, message, stamp)
        writer.add_metadata("ftbias", texts_of(arrays, about))
        writer.finish()

    write_atomic(path, write)


def topic(name: str) -> str:
    """The topic of an array."""
    return f"/ftbias/{name}"


def _words(name: str) -> dict[str, str]:
    """The metadata of a channel."""
    return {"unit": FIELDS[name].unit, "meaning": FIELDS[name].meaning, "sign": SIGN}


def wrench_message(stamp: int, frame: str, wrench: Array) -> bytes:
    """The bytes (CDR, little endian) of a geometry_msgs/msg/WrenchStamped, from ns, frame and wrench (6,) N, Nm."""
    seconds, nanoseconds = divmod(stamp, 10**9)
    name = frame.encode() + b"\x00"
    padding = -(12 + len(name)) % 8  # the numbers are aligned to eight bytes after the first four
    body = struct.pack(f"<III{len(name)}s{padding}x6d", seconds, nanoseconds, len(name), name, *wrench)
    return CDR + body


TABS: dict[str, dict[str, str]] = {
    "Bias": {"bias": "bias", "standard deviation of the bias": "bias_std"},
    "Wrench": {"corrected wrench": "wrench_unbiased", "wrench of the tool": "wrench_tool"},
    "Contact": {"contact wrench": "contact_wrench", "its standard deviation": "contact_wrench_std"},
    "Innovation": {"innovation": "innovation"},
}
"""Tab -> title and array of its plots, each of which is two, the force left of the torque."""
FLAG_PLOTS = {"Contact": ("in_contact", "used")}
"""Tab -> truth values in a plot of their own."""


def _plots(tab: str, between: str) -> list[tuple[str, list[str]]]:
    """Titles of the plots of a tab, and their lines: topic and field with something between the names."""
    plots = [
        (f"{title}, {part} [{unit}]", [between.join((topic(name), "wrench", part, axis)) for axis in "xyz"])
        for title, name in TABS[tab].items()
        for part, unit in (("force", "N"), ("torque", "Nm"))
    ]
    flags = FLAG_PLOTS.get(tab, ())
    return plots + ([(", ".join(flags), [between.join((topic(flag), "data")) for flag in flags])] if flags else [])


def foxglove_layout() -> str:
    """JSON for "Import from file"."""
    panels: dict[str, Any] = {}
    tabs = []
    for name in TABS:
        titled = _plots(name, ".")
        ids = [f"Plot!{name.lower()}{i}" for i in range(len(titled))]
        panels |= {one: _foxglove_plot(*content) for one, content in zip(ids, titled, strict=True)}
        rows = [_split("row", ids[i : i + 2]) for i in range(0, len(ids), 2)]
        tabs.append({"title": name, "layout": _split("column", rows)})
    panels["Tab!ftbias"] = {"activeTabIdx": 0, "tabs": tabs}
    layout = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": "Tab!ftbias",
    }
    return json.dumps(layout, indent=1) + "\n"


def _foxglove_plot(title: str, values: Sequence[str]) -> dict[str, Any]:
    paths = [
        {"value": value, "enabled": True, "timestampMethod": "headerStamp" if "wrench." in value else "receiveTime"}
        | {"color": colour, "label": value.rpartition(".")[2] if "wrench." in value else value}
        for value, colour in zip(values, COLOURS, strict=False)
    ]
    shown = {"showXAxisLabels": True, "showYAxisLabels": True, "showLegend": True, "legendDisplay": "floating"}
    return {"title": title, "paths": paths, "isSynced": True, "xAxisVal": "timestamp", "sidebarDimension": 240, **shown}


def _split(direction: str, panes: Sequence[Any]) -> Any:
    """Panes side by side ("row") or one above the other ("column"), of equal size: a binary tree."""
    if len(panes) == 1:
        return panes[0]
    share = 100 / len(panes)
    rest = _split(direction, panes[1:])
    return {"direction": direction, "first": panes[0], "second": rest, "splitPercentage": share}


def plotjuggler_layout() -> str:
    """XML for "Load layout"."""
    root = ET.Element("root")
    window = ET.SubElement(root, "tabbed_widget", {"name": "Main Window", "parent": "main_window"})
    for name in TABS:
        tab = ET.SubElement(window, "Tab", tab_name=name, containers="1")
        titled = _plots(name, "/")
        rows = [titled[i : i + 2] for i in range(0, len(titled), 2)]
        column = _splitter(ET.SubElement(tab, "Container"), "-", len(rows))
        for row in rows:
            panes = _splitter(column, "|", len(row))
            for title, curves in row:
                _plotjuggler_plot(panes, title, curves)
    ET.SubElement(window, "currentTabIndex", index="0")
    ET.SubElement(root, "use_relative_time_offset", enabled="1")
    ET.indent(root, " ")
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _splitter(above: ET.Element, orientation: str, count: int) -> ET.Element:
    """Room for so many panes; "-" = one above the other, "|" = side by side."""
    sizes = ";".join([f"{1 / count:.6f}"] * count)
    return ET.SubElement(above, "DockSplitter", orientation=orientation, sizes=sizes, count=str(count))


def _plotjuggler_plot(panes: ET.Element, title: str, curves: Sequence[str]) -> None:
    area = ET.SubElement(panes, "DockArea", name=title)
    plot = ET.SubElement(area, "plot", style="Lines", mode="TimeSeries", flip_x="false", flip_y="false")
    ET.SubElement(plot, "limitY")
    for name, colour in zip(curves, COLOURS, strict=False):
        ET.SubElement(plot, "curve", name=name, color=colour)


LAYOUTS: dict[str, Callable[[], str]] = {"foxglove": foxglove_layout, "plotjuggler": plotjuggler_layout}
"""Program -> what writes its layout."""
