"""What notebooks and interpreters show of results: short, escaped, with units."""

from __future__ import annotations

import html.parser

import numpy as np
import pytest

from crawler_lab import sensitivities, simulate_many
from crawler_model import Crawler, Scene, limit_cycle, load_scene, simulate
from crawler_model.notebook import write_html, write_numbers
from crawler_model.theory.stasis import StasisDomain

from .chains import scene


class Cells(html.parser.HTMLParser):
    """The text of a table, and its tags, which have to be closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.cells: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.cells.append(data)


def shown(thing: object) -> list[str]:
    text = thing._repr_html_()
    cells = Cells(text)
    assert cells.open == []
    assert len(text) < 4000
    assert len(repr(thing).splitlines()) == 1
    assert len(repr(thing)) < 700
    return cells.cells


@pytest.mark.parametrize("name", ["two_anchor_a", "hybrid_body", "planar_three_points", "ice"])
def test_results_are_shown_in_short(name):
    given = load_scene(name)
    run = simulate(given, 1.0, 10.0)
    assert shown(given)[0] == f"Scene {name}"
    assert shown(run)[0] == f"Trajectory of {name}"
    crawler = Crawler(given)
    step = crawler.follow(given.drive.targets[:2])
    assert shown(crawler)[0] == f"Crawler {name}"
    assert repr(crawler).startswith(f"Crawler({name}, {crawler.method}, net_translation ")
    assert "work [J]" in shown(step)
    runs = simulate_many([given], 1.0, 10.0)
    assert shown(runs)[0].startswith("ManyRuns: 1 runs")
    assert repr(run.energies).startswith("TickEnergies(10 ticks, in all work ")


def test_numbers_are_those_of_the_results():
    run = simulate(load_scene("two_anchor_a"), 3.0)
    cells = shown(run)
    assert cells[cells.index("net translation [m]") + 1] == "[0.5 6.5]"
    assert cells[cells.index("gained in each period [m]") + 1] == "[2. 2. 2.]"
    runs = simulate_many([load_scene("two_anchor_a"), load_scene("two_anchor_b")], 3.0)
    cells = shown(runs)
    low, high = sorted(runs.per_period.tolist())
    assert cells[cells.index("per_period [m]") + 1] == f"{low:.6g} .. {high:.6g}"
    assert cells[cells.index("done") + 1] == "2"


def test_derivatives_and_regimes_are_shown():
    given = load_scene("two_contacts_anisotropic")
    cells = shown(sensitivities(given, ["body.links.stiffness", "friction.forward"], 3.0, 7.0))
    assert cells[1] == "body.links.stiffness = 20"
    assert cells[2] == "0.001"
    assert "gain [m]" in shown(limit_cycle(given))
    assert "per_period" in cells[0]


def test_domains_are_shown_with_their_bounds():
    domain = StasisDomain(np.array([1.0, 2.0]), np.array([0.5, 0.25]))
    assert repr(domain) == "StasisDomain(forward=[1. 2.], backward=[0.5 0.25])"
    assert shown(domain) == ["StasisDomain", "forward [N]", "[1. 2.]", "backward [N]", "[0.5 0.25]"]


def test_large_bodies_stay_short():
    drive = {"times": [0, 1], "actuation": [[0.0] * 999, [0.1] * 999]}
    run = simulate(scene(1000, drive=drive), rate=2.0)
    crawler = Crawler(run.scene)
    for thing in (run, run.scene, crawler, StasisDomain(np.ones(1000), np.ones(1000))):
        shown(thing)
    assert "[1. 1. ... 1. 1.]" in repr(StasisDomain(np.ones(1000), np.ones(1000)))


def test_text_is_escaped():
    document = load_scene("two_anchor_a").document() | {"name": "<script>alert('&')</script>"}
    given = Scene.model_validate(document)
    for thing in (given, simulate(given, 0.1), Crawler(given)):
        assert "<script" not in thing._repr_html_()
        assert "<script>alert('&')</script>" in shown(thing)[0]
    assert Cells(write_html("<", [("<b>", "<i>" * 100)])).cells == ["<", "<b>", "<i>" * 40 + " ..."]


def test_long_arrays_are_abbreviated():
    assert write_numbers(np.arange(100.0)) == "[ 0. 1. ... 98. 99.]"
    assert write_numbers(0.5) == "0.5"
