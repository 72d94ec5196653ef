"""Mistakes that the functions of the packages refuse, with what would be right, besides scenes and commands."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from crawler_command.screen import parse_slower_than
from crawler_lab import Posterior, excite, identify, optimise, pareto, predict, sensitivities, vary
from crawler_lab.identify.measurements import MeasurementError, Measurements
from crawler_lab.play.session import Session
from crawler_lab.springs.springs import fit_springs
from crawler_lab.verbs.identify.options import parse_columns
from crawler_model import CommandError, Crawler, CrawlerError, Scene, SceneError
from crawler_model.theory.stasis import StasisDomain

PAIR = {"name": "pair", "body": {"contacts": [0.0, 1.0], "links": {"stiffness": 1.0}}, "friction": {"isotropic": 1.0}}
DRIVE = {"drive": {"times": [0, 1, 2], "period": 2, "actuation": [[0], [1], [0]]}}
FLAT = {"dimension": 2, "body": {"contacts": [[0, 0], [1, 0]], "links": {"stiffness": 1}}}
ONES = np.ones(4)


def pair(**more) -> Scene:
    return Scene.model_validate(PAIR | more)


def still() -> Measurements:
    time, commands = 0.1 * np.arange(10), np.zeros((10, 1))
    places = np.column_stack((0.0 * time, 1.0 + 0.0 * time))
    return Measurements("a", time, ("contact_0", "contact_1"), places, ("link_0",), commands, time)


def gap() -> Measurements:
    found = still()
    commands = np.array(found.commands)
    commands[4] = np.nan
    return dataclasses.replace(found, commands=commands)


def environments(**more):
    pytest.importorskip("gymnasium")
    from crawler_lab.gym.vector import CrawlerVectorEnv

    return CrawlerVectorEnv(2, pair(), **more)


def begun(**more):
    found = environments(**more)
    found.reset()
    return found


def fit(**bounds):
    return identify(
        pair(), [still()], ["friction.isotropic"], bounds={k.replace("_", "."): v for k, v in bounds.items()}
    )


def linked(*links, **more) -> Scene:
    return pair(body=PAIR["body"] | {"links": list(links)} | more)


REFUSED = [
    (lambda: pair(name="a\nb"), SceneError, "contains control characters; they must not get into terminals"),
    (lambda: pair(friction=None), SceneError, "friction: missing; isolated contacts need it"),
    (
        lambda: pair(**FLAT | {"friction": {"directions": [0, 120, 90], "value": 1}}),
        SceneError,
        "direction 2 at 90 rad follows 120 rad; angles must increase strictly, within one turn (they are in rad)",
    ),
    (lambda: pair(body={"contacts": [0]}), SceneError, "1 contact(s); a crawler needs at least 2, or a segment"),
    (
        lambda: fit_springs("a.csv", np.linspace(0.0, 0.1, 40), np.linspace(0.0, 2.0, 40)),
        CrawlerError,
        "a.csv: no reversal: the elongation goes one way from 0 to 0.1 m",
    ),
    (lambda: parse_columns(["HeadX"]), CrawlerError, "--columns HeadX: write OURS=THEIRS, for example contact_0=HeadX"),
    (lambda: parse_slower_than("slow"), CrawlerError, "--slower-than slow: write the largest inertia number, for exam"),
    (lambda: pair(body=PAIR["body"] | {"links": {"passive": {}}}), SceneError, "give `stiffness`, `curve` or `stops`"),
    (
        lambda: pair(body=PAIR["body"] | {"links": [{"tension": {"most": 1}}]}),
        SceneError,
        "stiffness: missing; or give a `curve`, or only a `passive` spring",
    ),
    (lambda: pair(**FLAT, loads=1.5), SceneError, "loads: 1.5; in the plane give [x, y] for all of 2 contact(s)"),
    (lambda: pair(**FLAT, loads=[[1, 0]] * 3), SceneError, "loads: 3 entries; in the plane give [x, y] for all of 2"),
    (
        lambda: Crawler(pair(**FLAT | {"friction": {"directions": [0, 2, 4], "value": 1}})).target(
            [[0, 0]], [[1, 1, -1], [1, 1, 1]]
        ),
        CommandError,
        "forward: contact_0/direction_2 is -1; friction must be >= 0",
    ),
    (lambda: StasisDomain(ONES, ONES).vertices(), ValueError, "4 contacts: the domain has dimension 3; vertices are"),
    (lambda: sensitivities(pair(**DRIVE), [3]), SceneError, "sensitivities: 3; a key is a string, for example"),
    (
        lambda: vary(pair(), {"friction.isotropic": [1.0] * 10_000, "body.links.stiffness": [1.0] * 1001}, grid=True),
        SceneError,
        "vary: 10000 x 1001 = 10010000 variations; at most 10000000",
    ),
    (lambda: excite(pair(**FLAT), ["friction.isotropic"]), CrawlerError, "excite: pair is in the plane, where paths"),
    (
        lambda: identify(pair(), [gap()], ["friction.isotropic"]),
        MeasurementError,
        "command/link_0 is nan in row 4 (time 0.4",
    ),
    (lambda: Posterior(("a", "b"), [1, 2], np.eye(2), held={"a": 1.0}), CrawlerError, "names: a is named twice; each"),
    (lambda: pareto(pair(**DRIVE), waypoint=3), TypeError, "pareto: unknown argument waypoint"),
    (
        lambda: optimise(pair(**DRIVE), robust={f"k{i}": (0.0, 1.0) for i in range(6)}),
        CommandError,
        "robust: 6 keys; at most 5, as every corner of their box is run",
    ),
    (lambda: Crawler(pair(**FLAT)).target([[0, 0]], backward=[1, 1]), CommandError, "each contact; omit `backward`"),
    (lambda: identify(pair(), [], ["friction.isotropic"]), CrawlerError, "no recording; at least one is needed"),
    (lambda: fit(friction_forward=(0, 1)), CrawlerError, "friction.forward: it is not fitted; fitted are friction.iso"),
    (lambda: fit(friction_isotropic=(1, 0.5)), CrawlerError, "friction.isotropic: 1 to 0.5; the first must be smaller"),
    (
        lambda: optimise(pair(**DRIVE), periods=3),
        SceneError,
        "periods: pair has one ground everywhere, so that its periods",
    ),
    (lambda: optimise(pair(**DRIVE), "turn"), SceneError, "pair does not turn, as it has no `springs: length`"),
    (lambda: optimise(linked({"passive": {"stiffness": 1}})), SceneError, "are all passive; no command moves it"),
    (
        lambda: linked({"stiffness": 1, "between": [0, 1]}, {"stiffness": 1}),
        SceneError,
        "body.links.1.between: missing; give it for every link, or for none",
    ),
    (
        lambda: linked({"stiffness": 1}, {"stiffness": 1}),
        SceneError,
        "2 entries; the chain of neighbours has 1 link(s)",
    ),
    (
        lambda: linked({"curve": {"elongation": [0, 1], "tension": [0]}}),
        SceneError,
        "elongation: 2 knot(s) for 1 value(s) of `tension`; give one each",
    ),
    (
        lambda: linked({"passive": {"stiffness": 1}, "tension": {"most": 1}}),
        SceneError,
        "tension: it limits an actuator; give its `stiffness` or `curve`, too",
    ),
    (lambda: sensitivities(pair(**DRIVE), ["friction.isotropic"] * 2), SceneError, "friction.isotropic is named twice"),
    (lambda: vary(pair(), {}), SceneError, "vary: no key; at least one is needed, for example friction.forward"),
    (lambda: StasisDomain([1.0], [1.0]), ValueError, "shapes (1,) and (1,); a stasis domain needs both values for at"),
    (lambda: StasisDomain(ONES, ONES).projection(2, 1), ValueError, "sections 2 and 1: they must be increasing and"),
    (
        lambda: Session(pair()).change({"mode": "scene"}),
        CommandError,
        "mode: scene; pair has no drive, use hand or wave",
    ),
    (
        lambda: predict(pair(**DRIVE), Posterior(("friction.isotropic",), [1.0], np.eye(1)), pair(name="still")),
        SceneError,
        "predict: still has no drive; without one nothing moves",
    ),
    (lambda: environments().step(np.zeros((2, 1))), CrawlerError, "step: no episode has begun; call reset first"),
    (
        lambda: begun().step(np.array([[0.0], [np.nan]])),
        CommandError,
        "action: link_0 of environment 1 is nan; it must",
    ),
    (lambda: optimise(pair(**DRIVE), slower_than=0.1), SceneError, "slower_than: pair has no masses; give body.masses"),
    (
        lambda: optimise(pair(**DRIVE), robust={"body.links.stifness": (0.9, 1.1)}),
        SceneError,
        "robust: body.links.stifness",
    ),
    (
        lambda: optimise(pair(**DRIVE), free={"body.links.stifness": (0.9, 1.1)}),
        SceneError,
        "free: body.links.stifness",
    ),
]


@pytest.mark.parametrize(("call", "kind", "message"), REFUSED, ids=[message for *_, message in REFUSED])
def test_a_mistake_is_refused_in_words_that_say_what_is_right(call, kind, message):
    with pytest.raises(kind) as error:
        call()
    assert message in str(error.value)
