"""The `crawler` command: its own verbs, verbs of packages by `crawler.verbs`, and how its errors are printed."""

from __future__ import annotations

import errno
import json
import sys
import tempfile
from collections.abc import Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, Any

import typer

from crawler_model import CrawlerError, __version__
from crawler_ros.node.life.exit import STOPPED, replace_unprintable

from .cite import cite
from .executables import describe_missing
from .pages import takes_page
from .recordings.compare import compare
from .replay import replay
from .run import run_controller
from .screen import (
    PICTURES,
    READERS,
    ForceOption,
    SceneArgument,
    check_output,
    progress_bar,
    require,
    screen,
    whole_file,
)
from .simulate import run_scene, simulate_command
from .view import animate, view

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",  # the default one takes words in brackets for styles
    context_settings={"help_option_names": ["-h", "--help"]},
)
_UsageError: Any = typer.BadParameter.__base__  # from click, or from typer's own copy of it
_PLAIN = {
    "Input should be a valid number, unable to parse string as a number": "it must be a number, without a unit",
    "Input should be a valid integer, unable to parse string as an integer": "it must be a whole number",
    "Value error, ": "",
}
"""What the library writes of a value of an option, and the same in plain words."""
_MOVED = {"bench": "python -m benchmarks, in a checkout of the project"}
"""Verbs that are no longer of the command, and what took their place."""


def _print_version(asked: bool) -> None:
    if asked:
        print(f"crawler {__version__}")
        raise typer.Exit


@app.callback()
def _about(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_print_version, help="Print the version and exit.")
    ] = False,
) -> None:
    """Exact soft crawlers in ROS 2. Start with `crawler demo`; `crawler scenes` lists the gallery."""


app.command("simulate")(simulate_command)


@app.command()
@takes_page
def check(
    scene: SceneArgument,
    png: Annotated[Path | None, typer.Option(help="Draw the stasis domain into this file: .png, .pdf or .svg.")] = None,
    mass: Annotated[
        float | None,
        typer.Option(help="Mass of each contact, kg, in segments kg/m: is the drive slow enough for it?"),
    ] = None,
    force: ForceOption = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
) -> None:
    """Validate a scene; print its stasis domain, directions of motion, margins and contacts that never slide."""
    from crawler_model import load_scene

    from .check import choose_rate, print_report, summarise, with_mass

    check_output("--png", png, PICTURES, force)
    loaded = load_scene(scene)
    if mass is not None:
        loaded = with_mass(loaded, mass)
    run = run_scene(loaded, None if not loaded.drive.holds else 0.0, choose_rate(loaded), None)
    if png is not None:
        from crawler_pictures.domain import draw_domain

        with whole_file(png) as part:
            draw_domain(run.scene, part)
    if as_json:
        print(json.dumps(summarise(run), allow_nan=False))
        return
    print_report(run, screen)
    if png is not None:
        screen.print(f"drawn: {png}", markup=False)


@app.command()
def scenes(
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON object of descriptions by name.")] = False,
) -> None:
    """List the scenes of the gallery, one per line."""
    from crawler_model import gallery

    listed = gallery()
    if as_json:
        print(json.dumps(listed))
        return
    width = max(map(len, listed))
    for name, text in listed.items():
        print(f"{name:<{width}}  {text}")


app.command("run")(run_controller)
app.command()(animate)
app.command()(view)
app.command("replay")(replay)
app.command("compare")(compare)
app.command()(cite)


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder for the recording, .rrd and .png files.")] = Path("demo"),
) -> None:
    """Watch a three-contact crawler walk: two ROS 2 processes, a recording, a picture, a summary."""
    require("rclpy", *READERS, "matplotlib", "rerun")
    from .demo import run_demo

    with progress_bar("walking") as progress:
        summary = run_demo(out, progress)
    print("\n".join(summary))


for _name, _point in sorted({point.name: point for point in entry_points(group="crawler.verbs")}.items()):
    app.command(_name)(_point.load())


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command; every expected error is one line on standard error.

    Args:
        arguments: the verb and its arguments; None for the arguments of the process.
    """
    replace_unprintable()
    try:
        status = app(arguments, prog_name="crawler", standalone_mode=False)
    except typer.Exit as error:
        status = error.exit_code
    except _UsageError as error:
        verb = f" {error.ctx.info_name}" if error.ctx is not None and error.ctx.parent is not None else ""
        text = " ".join(error.format_message().split())
        for of_the_library, ours in _PLAIN.items():
            text = text.replace(of_the_library, ours)
        if moved := [new for old, new in _MOVED.items() if f"No such command {old!r}" in text]:
            text = f"{text.partition(' Did you')[0]} It is now: {moved[0]}"
        elif "No such command" in text and "Did you mean" not in text:
            text += f" The commands are {', '.join(sorted(error.ctx.command.list_commands(error.ctx)))}."
        if text:  # else the command was called without a verb, and its help is printed
            print(f"crawler: {text} (see crawler{verb} --help)", file=sys.stderr)
        status = 2
    except (CrawlerError, OSError) as error:
        more = ""
        if isinstance(error, OSError) and error.errno == errno.ENOSPC and error.filename is None:
            more = f"; if it is the disk of the temporary folder {tempfile.gettempdir()}, name another with TMPDIR"
        print(f"crawler: {' '.join(str(error).split())}{more}", file=sys.stderr)
        status = 1
    except MemoryError:
        print("crawler: out of memory; free some, or raise the limit (ulimit -v)", file=sys.stderr)
        status = 1
    except ModuleNotFoundError as error:
        print(f"crawler: {describe_missing(error.name or str(error))}", file=sys.stderr)
        status = 1
    except typer.Abort as error:  # typer takes the end of any file for the end of an answer, though nothing here asks
        print(f"crawler: a file or a stream has ended unexpectedly: {error.__cause__}", file=sys.stderr)
        status = 1
    except KeyboardInterrupt:
        status = STOPPED
    if status == STOPPED:  # typer's status after Ctrl-C, too
        print("crawler: stopped", file=sys.stderr)
    sys.exit(status or 0)


if __name__ == "__main__":
    main()
