"""Layouts of other programs name topics and entries that the contract has."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from iolspi_ros import wire

ROOT = Path(__file__).parent.parent
LAYOUTS = ROOT / "config" / "layouts"
TOPICS = re.findall(
    r"^\| `(/?\w+)` \| [^|]+ \| [^|]+ → ", (ROOT / "docs/interfaces.md").read_text(), re.M
)
ROWS = {"reward": wire.REWARD, "score": wire.SCORE}


def paths():
    """Topic and the way into its message, of each that a layout draws."""
    foxglove = json.loads((LAYOUTS / "foxglove.json").read_text())["configById"]
    for panel in foxglove.values():
        for topic in panel.get("topics", {}):
            yield topic, ""
        if "topicToRender" in panel:
            yield panel["topicToRender"], ""
        for path in panel.get("paths", []):
            topic, _, inside = path["value"].partition(".")
            yield topic, f"{path['label']}:{inside}"
    for curve in ElementTree.parse(LAYOUTS / "plotjuggler.xml").iter("curve"):
        _, topic, inside = curve.get("name").split("/", 2)
        yield f"/{topic}", inside
    rviz = yaml.safe_load((LAYOUTS / "graph.rviz").read_text())["Visualization Manager"]
    for display in rviz["Displays"]:
        if "Topic" in display:
            yield f"/{display['Topic']['Value']}", ""


@pytest.mark.parametrize(("topic", "inside"), list(paths()))
def test_it_is_in_the_contract(topic, inside):
    assert {topic, topic[1:]} & set(TOPICS)
    label, _, _ = inside.rpartition(":")
    number = re.search(r"data\[(\d+)\]", inside)
    if number:
        entry = ROWS[topic[1:]][int(number[1])]
        assert entry in ("reward", "score", "source")
        assert label in ("", entry)


def test_rviz_looks_at_the_markers_in_their_frame():
    manager = yaml.safe_load((LAYOUTS / "graph.rviz").read_text())["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == "world"


def test_every_panel_of_foxglove_s_layout_is_there():
    layout = json.loads((LAYOUTS / "foxglove.json").read_text())

    def leaves(part):
        return [part] if isinstance(part, str) else leaves(part["first"]) + leaves(part["second"])

    assert sorted(leaves(layout["layout"])) == sorted(layout["configById"])
