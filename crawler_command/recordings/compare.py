"""The verb `compare`: recordings and scenes side by side."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from crawler_model import CrawlerError

from ..pages import takes_page
from ..replay import JsonOption
from ..screen import (
    PICTURES,
    READERS,
    ForceOption,
    NamespaceOption,
    SceneOption,
    check_output,
    is_recording,
    progress_bar,
    require,
    screen,
    whole_file,
)

if TYPE_CHECKING:
    from crawler_model import Scene
    from crawler_ros.replay.show.walks import Walk


@takes_page
def compare(
    runs: Annotated[
        list[str],
        typer.Argument(
            metavar="SCENE|BAG...",
            help="Two scenes or recordings or more, each compared with the first; or one folder of bags, in the order "
            "of their names. Where several are named, a folder of bags stands for its newest.",
        ),
    ],
    scene: SceneOption = None,
    as_json: JsonOption = False,
    png: Annotated[Path | None, typer.Option(help="Draw the runs to this file: .png, .pdf or .svg.")] = None,
    namespace: NamespaceOption = None,
    by_phase: Annotated[
        bool,
        typer.Option("--by-phase", help="Compare two recordings by the cycles of their drives, too, not by time."),
    ] = False,
    force: ForceOption = False,
) -> None:
    """Compare scenes and recordings: translation and energy of cycles, and for recordings commands and slips.

    crawler compare two_anchor_a two_anchor_b two_anchor_c --png three.png

    Scenes are simulated for ten periods. Runs are aligned by the cycles of their drives, however long these last, and
    begin with the first command. Only two recordings are compared on simulated time.
    """
    check_output("--png", png, PICTURES, force)
    scenes = [run for run in runs if not is_recording(run)]
    if len(scenes) < len(runs):
        require(*READERS)
    if len(runs) == 1 and not scenes:
        from crawler_ros.recording.bag_folder import list_bags

        runs = [str(bag) for bag in list_bags(Path(runs[0]))]
    if len(runs) < 2:
        raise CrawlerError(f"{runs[0]}: 1 run; a comparison needs two, or a folder of at least two bags")
    if by_phase or scenes or len(runs) > 2:
        _compare_walks(_walk_all(runs, scene, namespace), as_json, png)
    else:
        _compare_recordings(Path(runs[0]), Path(runs[1]), scene, namespace, as_json, png)


def _walk_all(runs: Sequence[str], scene: str | None, namespace: str | None) -> list[Walk]:
    """Simulate the scenes and read the recordings."""
    from crawler_model import load_scene, prepare
    from crawler_ros.replay.show.walks import name_walks, walk_of_recording, walk_of_scene

    loaded = None if scene is None else load_scene(scene)
    names = name_walks(runs)
    scenes: dict[str, Scene] = {run: load_scene(run) for run in runs if not is_recording(run)}
    for one in scenes.values():
        prepare(one)
    walks = []
    with progress_bar("comparing") as progress:
        for k, (run, name) in enumerate(zip(runs, names, strict=True)):
            progress(k / len(runs), name)
            if run in scenes:
                walks.append(walk_of_scene(name, scenes[run]))
            else:
                from crawler_ros.replay import analyse

                walks.append(walk_of_recording(name, analyse(Path(run), loaded, namespace)))
    return walks


def _compare_walks(walks: Sequence[Walk], as_json: bool, png: Path | None) -> None:
    from crawler_ros.replay.show.walks import draw_walks, print_walks

    if png is not None:
        with whole_file(png) as part:
            draw_walks(walks, part)
    if as_json:
        print(json.dumps({"schema": 1, "runs": [walk.as_plain() for walk in walks]}, allow_nan=False))
        return
    print_walks(walks, screen)
    if png is not None:
        screen.print(f"drawn: {png}", markup=False)


def _compare_recordings(
    first: Path, second: Path, scene: str | None, namespace: str | None, as_json: bool, png: Path | None
) -> None:
    from crawler_model import load_scene
    from crawler_ros.replay.show.compare import compare_recordings, print_comparison

    loaded = None if scene is None else load_scene(scene)
    with progress_bar("comparing") as progress:
        found = compare_recordings(first, second, loaded, namespace, progress)
    if png is not None:
        from crawler_ros.replay.show.compare_page import draw_comparison

        with whole_file(png) as part:
            draw_comparison(found, part)
    if as_json:
        print(json.dumps(found.as_plain(), allow_nan=False))
        return
    print_comparison(found, screen)
    if png is not None:
        screen.print(f"drawn: {png}", markup=False)
