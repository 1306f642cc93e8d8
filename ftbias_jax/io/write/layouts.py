"""Layouts of Foxglove and PlotJuggler for the topics that ``save_mcap`` writes; what a file lacks stays empty there.

Foxglove: JSON with a configuration for every panel (configById) and the tree of panels (layout), as its "Import from
file" reads it (foxglove/studio, packages/studio-base). PlotJuggler: XML of tabs, splitters and plots, as "Load layout"
reads it (facontidavide/PlotJuggler, plotjuggler_app).
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from ftbias_jax.io.write.mcap import topic

COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf")
"""In the order of the lines of a plot."""


class Plot(NamedTuple):
    """Lines over time."""

    title: str
    part: str
    """"force" (N) or "torque" (Nm)."""
    arrays: tuple[str, ...]

    def lines(self) -> Iterator[tuple[str, str]]:
        """Topic and path of the message's field, by dots."""
        for name in self.arrays:
            for axis in "xyz":
                yield topic(name), f"wrench.{self.part}.{axis}"


def _both(title: str, *arrays: str) -> tuple[Plot, Plot]:
    return Plot(f"{title}, force [N]", "force", arrays), Plot(f"{title}, torque [Nm]", "torque", arrays)


TABS: dict[str, tuple[Plot, ...]] = {
    "Bias": (*_both("bias", "bias"), *_both("standard deviation of the bias", "bias_std")),
    "Wrench": (*_both("corrected wrench", "wrench_unbiased"), *_both("wrench of the tool", "wrench_tool")),
    "Contact": (*_both("contact wrench", "contact_wrench"), *_both("its standard deviation", "contact_wrench_std")),
    "Innovation": _both("innovation", "innovation"),
}
"""Tab -> its plots, the force left of the torque."""
FLAGS = {"Contact": ("in_contact", "used")}
"""Tab -> truth values in a plot of their own."""


def foxglove_layout() -> str:
    """JSON for "Import from file"."""
    panels: dict[str, Any] = {}
    tabs = []
    for name, plots in TABS.items():
        titled = [(plot.title, [f"{t}.{field}" for t, field in plot.lines()]) for plot in plots]
        if name in FLAGS:
            titled.append((", ".join(FLAGS[name]), [f"{topic(flag)}.data" for flag in FLAGS[name]]))
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
    for name, plots in TABS.items():
        tab = ET.SubElement(window, "Tab", tab_name=name, containers="1")
        titled = [(plot.title, [f"{t}/{field.replace('.', '/')}" for t, field in plot.lines()]) for plot in plots]
        rows = [titled[i : i + 2] for i in range(0, len(titled), 2)]
        if name in FLAGS:
            rows.append([(", ".join(FLAGS[name]), [f"{topic(flag)}/data" for flag in FLAGS[name]])])
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
