"""A factor on friction changes friction, and nothing else below its keys."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("gymnasium")

from crawler_lab.gym.randomise import vary_scene
from crawler_model import Scene

CONTACTS = {"contacts": [0.0, 0.1, 0.2], "links": {"stiffness": 20.0}, "weights": 0.3}
POINTS = {"points": [[0.0, 0.0], [0.1, 0.0], [0.2, 0.05]], "springs": "length", "links": {"stiffness": 20.0}}
SEGMENT = {"name": "arm", "from": 0.0, "to": 0.4, "stiffness": 20.0, "elements": 4}
LINK = {"link": 1, "contacts": [0, 2], "elongation": [-0.01, 0.02]}
STRAIN = {"segment": "arm", "strain": [-0.1, 0.2]}
FRAME: dict[str, Any] = {"frame": [[0, 1], [1, 2], [1, 2]], "angle": [0.0, 0.1, 0.2], "law": "along_velocity"}


def on_contacts(friction: dict[str, Any]) -> dict[str, Any]:
    return {"body": CONTACTS, "friction": friction}


def of_segment(own: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"body": {"segments": [SEGMENT | {"friction": own}]}, **more}


def in_the_plane(friction: dict[str, Any]) -> dict[str, Any]:
    return {"dimension": 2, "body": POINTS, "friction": friction}


def in_directions(values: list[float]) -> dict[str, Any]:
    body = {"contacts": POINTS["points"], "links": {"stiffness": 20.0}}
    return {"dimension": 2, "body": body, "friction": {"directions": [0.0, 2.0, 4.0], "value": values}}


ONCE_AND_TWICE = {
    "coefficients": (
        on_contacts({"coefficient": {"forward": 0.5, "backward": [0.2, 0.3, 0.4]}}),
        on_contacts({"coefficient": {"forward": 1.0, "backward": [0.4, 0.6, 0.8]}}),
    ),
    "with elongations of links": (
        on_contacts({"isotropic": 0.2, "with_elongation": [LINK | {"forward": [0.0, 0.3], "backward": [0.1, 0.4]}]}),
        on_contacts({"isotropic": 0.4, "with_elongation": [LINK | {"forward": [0.0, 0.6], "backward": [0.2, 0.8]}]}),
    ),
    "with strains of segments": (
        of_segment({"isotropic": 2.0}, friction={"with_elongation": [STRAIN | {"added": [0.5, 3.0]}]}),
        of_segment({"isotropic": 4.0}, friction={"with_elongation": [STRAIN | {"added": [1.0, 6.0]}]}),
    ),
    "tables along segments": (
        of_segment({"forward": {"at": [0.0, 0.4], "value": [1.0, 3.0]}, "backward": 2.0}),
        of_segment({"forward": {"at": [0.0, 0.4], "value": [2.0, 6.0]}, "backward": 4.0}),
    ),
    "directions": (
        in_directions([1.0, 1.1, 1.2]),
        in_directions([2.0, 2.2, 2.4]),
    ),
    "frames": (
        in_the_plane({"forward": 0.1, "backward": 0.2, "left": 0.3, "right": [0.3, 0.2, 0.1], **FRAME}),
        in_the_plane({"forward": 0.2, "backward": 0.4, "left": 0.6, "right": [0.6, 0.4, 0.2], **FRAME}),
    ),
}


@pytest.mark.parametrize("kind", ONCE_AND_TWICE)
def test_a_factor_on_friction_leaves_links_contacts_places_and_angles_as_they_are(kind):
    once, twice = (Scene.model_validate({"name": "factors", **document}) for document in ONCE_AND_TWICE[kind])
    assert vary_scene(once, ("friction",), {"friction": np.array([2.0])})[0].document() == twice.document()
