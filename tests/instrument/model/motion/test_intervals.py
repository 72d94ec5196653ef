"""Where flat springs leave the translation open, it is reported, however long the body is and however ramps are cut."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from crawler_model import CommandError, Crawler, Scene, Step
from crawler_model.motion.line import build_records

from ..bent_bodies import draw_body

MOTOR = {"stiffness": 2.0, "tension": {"least": -1.0, "most": 1.0}}
SLACK = {"passive": {"stops": {"shortest": -40.0, "longest": 400.0, "stiffness": 1.0}}}
"""A link without tension as long as nothing goes far: a body behind it is a body of its own."""
SCALES = {"forward": 0.1, "backward": 0.37}
"""Friction of a contact of a body that walks."""


def stalling(contacts: int) -> Crawler:
    """A chain whose first motor comes to its limit as L is 0.5, which is the friction of its first contact."""
    crawler = Crawler(
        Scene.model_validate(
            {
                "name": "stalling",
                "body": {"contacts": list(range(contacts)), "links": MOTOR},
                "friction": {"forward": 2.0, "backward": 1.0},
            }
        )
    )
    assert crawler.advance([0.5] + [0.0] * (contacts - 2)).unique
    return crawler


@pytest.mark.parametrize("parts", [1, 2, 7, 512])
@pytest.mark.parametrize("contacts", [2, 3, build_records.FEW_CONTACTS, build_records.FEW_CONTACTS + 1, 400])
def test_a_motor_that_stalls_as_a_ramp_ends_leaves_the_next_one_open(contacts, parts):
    """The first contact may follow by 0.5 m or not, in one ramp or in many."""
    crawler = stalling(contacts)
    first = crawler.target(crawler.actuation)
    change = crawler.target([1.0] + [0.0] * (contacts - 2)) - first
    step = crawler.follow(np.array([first + change * (k / parts) for k in range(1, parts + 1)]))
    assert not step.unique
    assert step.translation_interval == pytest.approx((-0.5 / contacts, 0.0), abs=1e-14)


@pytest.mark.parametrize("end", [0.75, 0.5, 0.25, 0.0])
@pytest.mark.parametrize("contacts", [2, 3, build_records.FEW_CONTACTS + 1])
def test_a_contact_that_followed_stays_there_as_the_command_returns(contacts, end):
    """Where it had not followed, the motor is no longer at its limit; friction holds the contact in both places."""
    crawler = stalling(contacts)
    still = [0.0] * (contacts - 2)
    step = crawler.follow(np.array([crawler.target([1.0, *still]), crawler.target([end, *still])]))
    assert not step.unique
    assert step.translation_interval == pytest.approx((-0.5 / contacts, 0.0), abs=1e-14)


def run(document: dict[str, Any], parts: int = 1) -> list[tuple[np.ndarray, Step]]:
    """Follow a drive, each of its ramps in so many equal parts of one call: displacements and steps."""
    crawler = Crawler(Scene.model_validate(document))
    targets = crawler.scene.drive.targets
    found = []
    for before, after in itertools.pairwise(targets):
        rows = [before + (after - before) * (k / parts) for k in range(1, parts)]
        step = crawler.follow(np.array([*rows, after]))
        found.append((crawler.displacement.copy(), step))
    return found


def padded(document: dict[str, Any], count: int) -> dict[str, Any]:
    """The same body with more contacts, behind a slack link, that nothing moves."""
    body, drive = document["body"], document["drive"]
    n = len(body["contacts"])
    links = [SLACK | {"between": [n - 1, n]}]
    links += [{"stiffness": 1.0, "between": [n + i, n + i + 1]} for i in range(count - 1)]
    contacts = [*body["contacts"], *(body["contacts"][-1] + 50.0 + i for i in range(count))]
    friction = {side: [*document["friction"][side], *[1.0] * count] for side in ("forward", "backward")}
    commands = {side: [[*row, *[1.0] * count] for row in drive["friction"][side]] for side in friction}
    actuation = [[*row, *[0.0] * count] for row in drive["actuation"]]
    return document | {
        "body": body | {"contacts": contacts, "links": [*body["links"], *links]},
        "friction": friction,
        "drive": drive | {"actuation": actuation, "friction": commands},
    }


def random_bodies(first: int, count: int) -> list[dict[str, Any]]:
    """Bodies of 2 to 6 contacts whose numbers are eighths, so that contacts and knots tie."""
    found = []
    for seed in range(first, first + count):
        rng = np.random.default_rng([seed, 77])
        found.append(draw_body(rng, int(rng.integers(2, 7)), int(rng.integers(0, 2)))[0])
    return found


def compare(documents: list[dict[str, Any]], change: Any, **how: int) -> int:
    """Compare each body with a changed one, up to the first ramp that friction leaves open; return how many are."""
    several = 0
    for document in documents:
        n = len(document["body"]["contacts"])
        try:
            here = run(document)
        except CommandError:  # loads that nothing holds
            continue
        other = change(document)
        parts = len(other["body"]["contacts"]) / n
        for (x, step), (x_other, step_other) in zip(here, run(other, **how), strict=True):
            assert step_other.unique == step.unique
            least, most = step.translation_interval
            size = 1.0 + most - least
            assert np.array(step_other.translation_interval) * parts == pytest.approx((least, most), abs=1e-9 * size)
            assert x_other[:n] == pytest.approx(x, abs=1e-10)
            if not step.unique:
                several += 1
                break
    return several


@pytest.mark.parametrize("first", [0, 100])
def test_contacts_that_rest_beside_a_body_change_nothing(first):
    assert compare(random_bodies(first, 40), lambda document: padded(document, build_records.FEW_CONTACTS)) > 2


@pytest.mark.parametrize("first", [0, 1000])
def test_looking_only_where_rates_are_new_changes_nothing(first, monkeypatch):
    documents = random_bodies(first, 200)

    def lean(document: dict[str, Any]) -> dict[str, Any]:
        monkeypatch.setattr(build_records, "FEW_CONTACTS", 0)
        return document

    several = 0
    for document in documents:
        monkeypatch.setattr(build_records, "FEW_CONTACTS", 256)
        several += compare([document], lean)
    assert several > 10


def beside_a_walker(document: dict[str, Any], count: int) -> dict[str, Any]:
    """The same body, and behind a slack link another one whose links lengthen and shorten in turn."""
    other = padded(document, count)
    actuation = other["drive"]["actuation"]
    for k, row in enumerate(actuation):
        row[1 - count :] = [0.4 * (np.sin(1.7 * k + i) - np.sin(i)) for i in range(count - 1)]
    friction = {side: other["friction"][side][:-count] + [bound] * count for side, bound in SCALES.items()}
    commands = {
        side: [[*row[:-count], *[bound] * count] for row in other["drive"]["friction"][side]]
        for side, bound in SCALES.items()
    }
    return other | {"friction": friction, "drive": other["drive"] | {"friction": commands}}


def test_what_happens_elsewhere_changes_no_free_part():
    """A translation that is chosen lasts until an event of its own part."""
    several = 0
    for document in random_bodies(0, 150):
        n = len(document["body"]["contacts"])
        try:
            here = run(document)
        except CommandError:  # loads that nothing holds
            continue
        for (x, step), (x_other, step_other) in zip(here, run(beside_a_walker(document, 6)), strict=True):
            assert step_other.unique == step.unique
            assert x_other[:n] == pytest.approx(x, abs=1e-10)
            if not step.unique:
                several += 1
                break
    assert several > 10


@pytest.mark.parametrize("first", range(0, 250, 50))
def test_the_motions_of_a_ramp_in_parts_lie_within_its_interval(first):
    """Each part of a ramp chooses anew: one motion of several comes to a taut spring before the others."""
    several = 0
    for document in random_bodies(first, 50):
        try:
            runs = {parts: run(document, parts) for parts in (1, 3, 64)}
        except CommandError:  # loads that nothing holds
            continue
        k = next((k for k, (_, step) in enumerate(runs[1]) if not step.unique), None)
        if k is None:
            continue
        several += 1
        gains = [np.mean(ramps[k][0] - (ramps[k - 1][0] if k else 0.0)) for ramps in runs.values()]
        for ramps in runs.values():
            least, most = ramps[k][1].translation_interval
            assert least - 1e-9 <= min(gains)
            assert max(gains) <= most + 1e-9
    assert several > 2
