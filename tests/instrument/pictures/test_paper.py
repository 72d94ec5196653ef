"""Pictures for a paper pass the checklist of a journal: width, letters, fonts, no heading, and greys that differ."""

from __future__ import annotations

import itertools
import re
import zlib
from dataclasses import replace

import pytest

pytest.importorskip("matplotlib")
import numpy as np
from PIL import Image

from crawler_lab import simulate_many, vary
from crawler_lab.pictures.sweep import draw_sweep
from crawler_model import load_scene, simulate
from crawler_pictures.colors import ACTUATION, BACK, FORWARD
from crawler_pictures.domain import draw_domain
from crawler_pictures.run.arrays import Gains
from crawler_pictures.run.run_page import draw_run
from crawler_pictures.run.trajectory import read_trajectory
from crawler_pictures.style import COLUMN, LETTERS, PRINTED, Page, on_page

from ...commands import crawler
from ...golden_pictures import crowded_pictures, crowded_words

POINTS_PER_MM = 72.0 / 25.4
NAME = "three_contacts_two_ways"
SUBSCRIPT = 0.7  # of the size of its letters, in matplotlib


@pytest.fixture(scope="module")
def drawings():
    three = load_scene(NAME)
    run = simulate(three, 2.0)
    variations = vary(three, {"friction.forward": [0.1, 0.6], "body.links.stiffness": [5.0, 20.0]})
    many = simulate_many(variations)
    return {
        "run": lambda file: draw_run(read_trajectory(run), file),
        "domain of three": lambda file: draw_domain(three, file),
        "domain of two": lambda file: draw_domain(load_scene("two_anchor_a"), file),
        "sweep": lambda file: draw_sweep(variations, dict.fromkeys(variations.values, "1"), (), many, file),
    }


def width_of(pdf: bytes) -> float:
    """The width of a page [mm]."""
    return float(re.search(rb"/MediaBox \[ 0 0 ([\d.]+)", pdf)[1]) / POINTS_PER_MM


def letters_of(pdf: bytes) -> set[float]:
    """The sizes of all letters [points]."""
    found = set()
    for stream in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", pdf, re.DOTALL):
        try:
            found |= {float(size) for size in re.findall(rb"/F[\w-]* ([\d.]+) Tf", zlib.decompress(stream))}
        except zlib.error:  # a font or an image
            continue
    return found


@pytest.mark.parametrize("what", ["run", "domain of three", "domain of two", "sweep"])
def test_a_pdf_is_one_column_wide_with_embedded_letters_of_eight_points(drawings, what, tmp_path):
    with on_page(Page(paper=True)):
        drawings[what](tmp_path / "x.pdf")
    pdf = (tmp_path / "x.pdf").read_bytes()
    assert width_of(pdf) == pytest.approx(COLUMN, abs=0.1)
    sizes = letters_of(pdf)
    assert LETTERS in sizes
    assert {round(size, 3) for size in sizes} <= {LETTERS, SUBSCRIPT * LETTERS}
    assert b"/FontFile2" in pdf
    assert b"/Type3" not in pdf
    assert b"Serif" in pdf


CROWDED = ["two_contacts_anisotropic", "tendon_worm", "ten_link_snake", "hybrid_body"]


@pytest.mark.parametrize("name", CROWDED)
def test_no_words_of_a_run_leave_the_column_or_cover_each_other(name, tmp_path):
    run = read_trajectory(simulate(load_scene(name), 2.0))
    with on_page(Page(paper=True)), crowded_pictures() as crowded:
        draw_run(run, tmp_path / "x.pdf")
        draw_run(replace(run, gains=Gains(np.ones(4), np.ones(4, bool), (1.0, 1.0), 2)), tmp_path / "x.pdf")
    assert crowded == []


@pytest.mark.parametrize("name", ["two_anchor_a", NAME, "hybrid_body", "planar_three_points", "scissors"])
def test_no_words_of_a_domain_leave_the_column_or_cover_each_other(name, tmp_path):
    with on_page(Page(paper=True)), crowded_pictures() as crowded:
        draw_domain(load_scene(name), tmp_path / "x.pdf")
    assert crowded == []


def test_words_that_leave_a_picture_or_cover_each_other_are_found():
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.0, 2.0))
    figure.text(0.9, 0.5, "leaves the picture")
    figure.text(0.1, 0.5, "one")
    figure.text(0.12, 0.5, "two")
    assert crowded_words(figure) == ["leaves the picture", "one over two"]


def words_of(drawing, file) -> str:
    drawing(file)
    return "\n".join(re.findall(r"<!-- (.*?) -->", file.read_text(encoding="utf-8")))


@pytest.mark.parametrize("what", ["run", "domain of three", "sweep"])
def test_a_paper_has_no_heading_and_a_screen_has_one(drawings, what, tmp_path):
    with on_page(Page(paper=True)):
        assert NAME not in words_of(drawings[what], tmp_path / "paper.svg")
    assert NAME.replace("_", r"\_") in words_of(drawings[what], tmp_path / "screen.svg").replace("_", r"\_")


def test_a_paper_shows_the_same_quantities_as_a_screen(drawings, tmp_path):
    with on_page(Page(paper=True)):
        paper = words_of(drawings["run"], tmp_path / "paper.svg").replace("\n[", " [")
    for words in ("slips forward", "slips back", "sticks", "position [m]", "translation [m]", "T 1 [N]", "link 1"):
        assert words in paper
        assert words in words_of(drawings["run"], tmp_path / "screen.svg")


def lightness(color: str) -> float:
    """CIE L* of a colour, 0 .. 100."""
    part = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    linear = np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)
    return float(116.0 * np.cbrt(linear @ (0.2126, 0.7152, 0.0722)) - 16.0)


def test_slips_forward_and_back_and_what_sticks_differ_in_grey(drawings, tmp_path):
    for one, other in itertools.combinations(PRINTED.values(), 2):
        assert abs(lightness(one) - lightness(other)) > 15.0
    with on_page(Page(paper=True, dpi=150.0)):
        drawings["run"](tmp_path / "x.png")
    pixels = np.asarray(Image.open(tmp_path / "x.png").convert("RGB")).reshape(-1, 3)
    there = {f"#{r:02x}{g:02x}{b:02x}" for r, g, b in np.unique(pixels, axis=0).tolist()}
    assert there >= set(PRINTED.values())
    assert there.isdisjoint({FORWARD, BACK})


def test_two_commands_differ_by_their_dashes(drawings, tmp_path):
    with on_page(Page(paper=True)):
        drawings["run"](tmp_path / "x.svg")
    lines = re.findall(
        rf"fill: none; (stroke[^\"]*{ACTUATION}[^\"]*)", (tmp_path / "x.svg").read_text(encoding="utf-8")
    )
    assert lines
    assert all("stroke-dasharray" in line for line in lines)


def test_every_verb_that_draws_takes_resolution_width_and_style(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ("check", "two_anchor_a", "--style", "paper", "--width", "170")
    assert crawler(*words, "--png", "x.pdf").returncode == 0
    assert width_of((tmp_path / "x.pdf").read_bytes()) == pytest.approx(170.0, abs=0.1)
    assert crawler(*words, "--png", "x.png", "--dpi", "50").returncode == 0
    with Image.open(tmp_path / "x.png") as picture:
        assert picture.width == pytest.approx(170.0 / 25.4 * 50.0, abs=1.0)
    refused = crawler(*words)
    assert (refused.returncode, "--width and --style need --png" in refused.stderr) == (1, True)
