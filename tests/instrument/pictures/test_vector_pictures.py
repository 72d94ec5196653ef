"""Pictures as lines and letters: .pdf with fonts that editors can use, .svg that needs none, equal bytes each time."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import pytest

pytest.importorskip("matplotlib")

from ...commands import crawler

PICTURES = {
    "simulate": ("simulate", "two_anchor_a", "--duration", "1"),
    "check": ("check", "three_contacts_two_ways"),
    "compare": ("compare", "two_anchor_a", "two_anchor_b"),
}


@pytest.mark.parametrize("name", PICTURES)
def test_pdf_and_svg_hold_lines_and_letters(tmp_path, name):
    pdf, svg = tmp_path / "a.pdf", tmp_path / "a.svg"
    for file in (pdf, svg):
        assert crawler(*PICTURES[name], "--png", str(file)).returncode == 0
    data = pdf.read_bytes()
    assert data.startswith(b"%PDF")
    assert b"/FontFile2" in data  # TrueType, embedded
    assert b"/Type3" not in data
    root = ET.fromstring(svg.read_text())
    assert root.tag.endswith("svg")
    assert len(root.findall(".//{*}path")) > 50
    assert not root.findall(".//{*}text")  # letters are paths: no font is needed
    links = [value for element in root.iter() for key, value in element.attrib.items() if key.endswith("}href")]
    assert all(link.startswith(("#", "data:")) for link in links)  # nothing from other files


def test_equal_runs_draw_equal_bytes(tmp_path):
    for suffix in ("pdf", "svg", "png"):
        files = [tmp_path / f"{k}.{suffix}" for k in range(2)]
        for file in files:
            assert crawler(*PICTURES["check"], "--png", str(file)).returncode == 0
        assert files[0].read_bytes() == files[1].read_bytes(), suffix


def test_another_end_of_a_name_is_refused(tmp_path):
    found = crawler(*PICTURES["check"], "--png", str(tmp_path / "a.gif"))
    assert found.returncode == 1
    assert "a.gif must end in .png or .pdf or .svg" in found.stdout + found.stderr
