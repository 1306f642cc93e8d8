"""Layouts name the topics and fields of an MCAP result, in the structure that each program reads."""

import json
import re
import xml.etree.ElementTree as ET

import pytest

from ftbias_jax.cli.main import main
from ftbias_jax.io.write.mcap import FLAGS, LAYOUTS, TOPICS, layout

WRENCH = re.compile(r"/ftbias/(\w+)\.wrench\.(force|torque)\.[xyz]")


def panes(tree):
    """Ids of the panels in a layout tree of Foxglove, whose nodes have two branches and sizes in percent."""
    if isinstance(tree, str):
        return [tree]
    assert tree["direction"] in ("row", "column")
    assert 0 < tree["splitPercentage"] < 100
    return panes(tree["first"]) + panes(tree["second"])


def test_foxglove_shows_every_panel_once_and_only_topics_that_are_written():
    said = json.loads(layout("foxglove"))
    assert {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"} == said.keys()
    tabs = said["configById"][said["layout"]]["tabs"]
    shown = [pane for tab in tabs for pane in panes(tab["layout"])]
    assert sorted(shown) == sorted({*said["configById"]} - {said["layout"]})
    arrays = set()
    for pane in shown:
        assert pane.startswith("Plot!")
        for path in said["configById"][pane]["paths"]:
            if found := WRENCH.fullmatch(path["value"]):
                arrays.add(found[1])
                assert path["timestampMethod"] == "headerStamp"
            else:  # no header
                flag = re.fullmatch(r"/ftbias/(\w+)\.data", path["value"])[1]
                assert (flag in FLAGS, path["timestampMethod"]) == (True, "receiveTime")
    assert arrays == {*TOPICS} - {"bias_smooth"}


def test_plotjuggler_has_as_many_panes_as_its_splitters_say_and_the_names_of_its_ros_parser():
    root = ET.fromstring(layout("plotjuggler"))
    assert (root.tag, root[0].tag) == ("root", "tabbed_widget")
    assert [tab.get("tab_name") for tab in root.iter("Tab")] == ["Bias", "Wrench", "Contact", "Innovation"]
    for splitter in root.iter("DockSplitter"):
        sizes = [float(size) for size in splitter.get("sizes").split(";")]
        assert len(splitter) == len(sizes) == int(splitter.get("count"))
        assert sum(sizes) == pytest.approx(1, abs=1e-5)
        assert splitter.get("orientation") in "-|"
    titles = [area.get("name") for area in root.iter("DockArea")]
    assert {"bias, force [N]", "contact wrench, torque [Nm]", "in_contact, used"} <= {*titles}
    assert all(len(area) == 1 and area[0].tag == "plot" for area in root.iter("DockArea"))
    names = [curve.get("name") for curve in root.iter("curve")]
    wrenches = {
        f"/ftbias/{array}/wrench/{part}/{axis}" for array in TOPICS for part in ("force", "torque") for axis in "xyz"
    }
    assert {*names} - wrenches == {f"/ftbias/{flag}/data" for flag in FLAGS}
    assert len(names) == len({*names})
    assert all(re.fullmatch(r"#[0-9a-f]{6}", curve.get("color")) for curve in root.iter("curve"))


@pytest.mark.parametrize("name", LAYOUTS)
def test_the_command_writes_them_without_a_setup(tmp_path, name, capsys):
    assert main(["export", "--format", name, "-o", str(tmp_path / "layout")]) == 0
    assert (tmp_path / "layout").read_text() == layout(name)
    assert capsys.readouterr().out == f"wrote {tmp_path / 'layout'}\n"
