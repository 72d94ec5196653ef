"""The page of a replay and the figure of a comparison, against pictures that were looked at."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")
from crawler_model import Scene, load_scene
from crawler_pictures.marks import SLACK
from crawler_ros.replay import Replay, analyse
from crawler_ros.replay.show.compare import compare_recordings
from crawler_ros.replay.show.compare_page import draw_comparison
from crawler_ros.replay.show.replay_page import draw_replay, read_replay
from crawler_ros.replay.show.samples import Samples

from ...golden_pictures import GOLDEN, TOLERANCE, differences, distance, words_of_figures
from ...recordings import record


def strategy_b(name: str, length: float) -> Scene:
    plain = load_scene("two_anchor_b").document()
    plain["name"], plain["drive"]["length"] = name, length
    return Scene.model_validate(plain)


def sample(path: Path) -> tuple[Replay, Samples]:
    kept = []

    def open_samples(survey, scene):
        kept.append(Samples(survey))
        return kept

    return analyse(path, sinks=open_samples), kept[0]


def draw_page(path: Path, png: Path) -> Path:
    draw_replay(*sample(path), png)
    return png


def test_a_page_marks_slack_and_draws_the_tendon_apart_from_its_return_spring(tmp_path):
    found, samples = sample(record(tmp_path / "tendon", "tendon_worm", 2, wait=0.0))
    run = read_replay(found, samples)
    slack = run.marks[1:, 0] == SLACK
    assert found.at_limits is not None
    assert slack.sum() / 100.0 == pytest.approx(found.at_limits["link_0"]["slack"])
    assert not run.own[1:, 0][slack].any()
    assert (run.own[1:, 0][~slack] >= 0.0).all()
    assert run.own.max() > 1.5
    passive = 2.0 * (np.diff(run.positions[1:], axis=1)[:, 0] - 1.0)
    np.testing.assert_allclose(run.tension[1:, 0] - run.own[1:, 0], passive, atol=1e-12)
    with words_of_figures() as words:
        draw_replay(found, samples, tmp_path / "page.png")
    assert {"slack", "of the actuator alone"} <= set(words[0].splitlines())


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    folder = tmp_path_factory.mktemp("golden")
    bags = {name: record(folder / name, strategy_b(name, float(name[1:])), 5) for name in ("b3", "b6")}
    with words_of_figures() as words:
        pages = {name: draw_page(bag, folder / f"{name}.png") for name, bag in bags.items()}
        draw_comparison(compare_recordings(bags["b3"], bags["b6"]), folder / "compare.png")
    for name, text in zip((*pages, "compare"), words, strict=True):
        (folder / f"{name}.txt").write_text(text, "utf-8")
    return {**pages, "compare": folder / "compare.png"}


@pytest.mark.parametrize("name", ["b6", "compare"])
def test_the_picture_is_the_one_that_was_looked_at(drawn, name):
    assert distance(drawn[name], GOLDEN / f"replay_{name}.png") < TOLERANCE


@pytest.mark.parametrize("name", ["b6", "compare"])
def test_its_words_and_curves_are_those_that_were_read(drawn, name):
    assert not differences(drawn[name].with_suffix(".txt").read_text("utf-8"), GOLDEN / f"replay_{name}.txt")


DOCS = Path(__file__).parent.parent.parent.parent / "docs"


@pytest.mark.parametrize("page", ["start", "replay"])
def test_documents_show_the_page_as_it_is(drawn, page, tmp_path):
    shown = drawn["b6"]
    if page == "start":
        (text,) = re.findall(r"```yaml\n(# my_crawler.yaml.*?)```", (DOCS / "start.md").read_text("utf-8"), re.DOTALL)
        (tmp_path / "my_crawler.yaml").write_text(text, encoding="utf-8")
        bag = record(tmp_path / "bag", load_scene(str(tmp_path / "my_crawler.yaml")), 3)
        shown = draw_page(bag, tmp_path / "walk.png")
    assert distance(shown, DOCS / "pictures" / f"{page}.png") < TOLERANCE


def test_another_run_is_told_from_it(drawn):
    assert distance(drawn["b3"], GOLDEN / "replay_b6.png") > 2.0 * TOLERANCE
