"""The layouts for Foxglove and PlotJuggler: every curve in them is in a recording of the default scene."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags")
from rosbags.highlevel import AnyReader

from ...recordings import record

LAUNCH = Path(__file__).parent.parent.parent.parent / "launch"
PATHS = [
    series["value"]
    for name, panel in json.loads((LAUNCH / "crawler.foxglove.json").read_text())["configById"].items()
    if name.startswith("Plot!")
    for series in panel["paths"]
]
CURVES = [curve.get("name") for curve in ET.parse(LAUNCH / "crawler.plotjuggler.xml").iter("curve")]


@pytest.fixture(scope="module")
def last(tmp_path_factory):
    """The last message of each topic."""
    path = record(tmp_path_factory.mktemp("layout") / "a", "three_contacts_one_way", 1)
    with AnyReader([path]) as reader:
        return {c.topic: reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages()}


def follow(message: object, fields: list[str]) -> float:
    for field in fields:
        name, index = re.fullmatch(r"(\w+)(?:\[(\d+)\])?", field).groups()
        message = getattr(message, name)
        message = message if index is None else message[int(index)]
    return float(message)


@pytest.mark.parametrize("path", PATHS)
def test_foxglove_finds_a_number(last, path):
    topic, *fields = path.split(".")
    assert np.isfinite(follow(last[topic], fields))


@pytest.mark.parametrize("curve", CURVES)
def test_plotjuggler_finds_a_number(last, curve):
    """PlotJuggler names the numbers of a JointState by the joint."""
    topic, *fields = curve.lstrip("/").split("/")
    message = last[f"/{topic}"]
    if hasattr(message, "name"):
        joint, quantity = fields
        assert np.isfinite(getattr(message, quantity)[message.name.index(joint)])
    else:
        assert np.isfinite(follow(message, fields))


def test_both_show_the_same(last):
    assert len(PATHS) == len(CURVES) == 9


def test_every_panel_of_the_foxglove_layout_has_its_place():
    layout = json.loads((LAUNCH / "crawler.foxglove.json").read_text())

    def panels(part):
        return [part] if isinstance(part, str) else panels(part["first"]) + panels(part["second"])

    assert sorted(panels(layout["layout"])) == sorted(layout["configById"])
