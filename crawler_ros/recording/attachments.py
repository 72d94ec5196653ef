"""The attachments of a recording: all that is needed to simulate it again."""

from __future__ import annotations

from typing import Any

from crawler_model import Crawler, Scene

from .versions import versions


def describe_run(scene: Scene, crawler: Crawler, parameters: dict[str, Any], node: str) -> dict[str, Any]:
    """Describe a run at its start.

    Args:
        scene: the scene that runs.
        crawler: the crawler at its start.
        parameters: parameters of the node.
        node: full name of the node.

    Returns:
        Plain data by name: scene, parameters, versions, node, start.
    """
    return {
        "scene": scene.document(),
        "parameters": parameters | {"method": crawler.method},
        "versions": versions(),
        "node": node,
        "start": {
            "displacement": crawler.displacement.tolist(),
            "tension": crawler.tension.tolist(),
            "actuation": crawler.actuation.tolist(),
            "friction": crawler.friction.tolist(),
        },
    }
