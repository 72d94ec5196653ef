"""The verb `check`: validation of a scene and of its motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from crawler_model import load_scene

from .scene_report import print_report
from .screen import SceneArgument, check_picture, screen
from .simulate import run_scene


def check(
    scene: SceneArgument,
    png: Annotated[Path | None, typer.Option(help="Draw the stasis domain into this file.")] = None,
) -> None:
    """Validate a scene; print its stasis domain, directions of motion, margins and contacts that never slide."""
    check_picture(png)

    loaded = load_scene(scene)
    run = run_scene(loaded, None if not loaded.drive.holds else 0.0, 100.0, None)
    print_report(run, screen)
    if png is not None:
        from crawler_pictures.domain import draw_domain

        draw_domain(run.scene, png)
        screen.print(f"drawn: {png}")
