"""The verb `play`: a page on this machine in which a person drives a crawler."""

from __future__ import annotations

import asyncio
import webbrowser
from typing import Annotated

import typer

from crawler_command.screen import SceneArgument, require, screen
from crawler_model import CrawlerError
from crawler_model.run.ticks import DEFAULT_RATE


def play(
    scene: SceneArgument,
    rate: Annotated[float, typer.Option(help="Ticks per simulated second, Hz.")] = DEFAULT_RATE,
    port: Annotated[int, typer.Option(help="Port on 127.0.0.1; 0 for any free one.", min=0, max=65535)] = 0,
    state: Annotated[str | None, typer.Option(help="The end of a link to a state, behind #state=.")] = None,
    ros: Annotated[
        bool, typer.Option("--ros", help="Command a robot with topics instead: a simulator, or a real one.")
    ] = False,
    namespace: Annotated[str, typer.Option(help="With --ros: the namespace of the robot.")] = "/",
    browser: Annotated[bool, typer.Option("--open", help="Open the page in the browser of this desktop.")] = False,
) -> None:
    """Drive a crawler by hand, in a page on 127.0.0.1: sliders, a wave, undo, pictures, and what happens in words.

    `crawler play two_anchor_a` prints an address that contains a token: only someone who knows it can see or move the
    crawler. Everything is exact; what was found can be saved as a scene, a recording, a picture, a film or a link. With
    --ros the sliders command a robot: in ramps of limited rate, and only while the page is open.
    """
    require("aiohttp", *(["rclpy"] if ros else []))
    from crawler_model import load_scene, prepare

    from ..play.server import Server, serve

    def ready(address: str) -> None:
        screen.print(f"open {address}", soft_wrap=True)
        screen.print("Ctrl-C ends it")
        if browser and not webbrowser.open(address):
            raise CrawlerError("--open: this desktop has no browser; open the address that was printed")

    loaded = load_scene(scene)
    if namespace != "/" and not ros:
        raise CrawlerError(f"--namespace: {namespace}; only a robot has one, add --ros")
    if ros:
        from ..play.console import open_console

        if state is not None:
            raise CrawlerError("--state: only a simulated crawler can be put into a state; leave out --ros")
        with open_console(loaded, namespace) as console:
            asyncio.run(serve(Server(console), port, ready))
        return
    from ..play.simulated import Simulated

    prepare(loaded)
    robot = Simulated(loaded, rate)
    if state is not None:
        robot.session.restore(state.rpartition("#state=")[2])
    asyncio.run(serve(Server(robot), port, ready))
