"""The `crawler` command: its verbs, and how its errors are printed."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from crawler_model import CrawlerError, gallery, load_scene
from crawler_ros.node.life.leave import STOPPED

from .bench import bench
from .check import check
from .executables import describe_missing
from .replay import compare, replay
from .screen import DurationOption, MethodName, MethodOption, SceneArgument, progress_bar
from .simulate import simulate_command
from .view import view

app = typer.Typer(
    help="Exact soft crawlers in ROS 2. Start with `crawler demo`; `crawler scenes` lists what can be run.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
_UsageError: Any = typer.BadParameter.__base__  # click's, or typer's own copy of it

app.command("simulate")(simulate_command)
app.command()(check)


@app.command()
def scenes(
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON object, name to description.")] = False,
) -> None:
    """List the gallery, a line each."""
    listed = gallery()
    if as_json:
        print(json.dumps(listed))
        return
    width = max(map(len, listed))
    for name, text in listed.items():
        print(f"{name:<{width}}  {text}")


@app.command()
def sweep(
    scene: SceneArgument,
    vary: Annotated[
        list[str],
        typer.Option(
            metavar="KEY=FROM:TO:N",
            help="A number of the scene by its dotted key, and what it takes: FROM:TO:N, log:FROM:TO:N or A,B,C. "
            "Given several times: every combination.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="The table to write, .parquet; it must not be there already.")],
    duration: DurationOption = None,
    rate: Annotated[float, typer.Option(help="Ticks per second, Hz; exact needs none.")] = 100.0,
    method: MethodOption = MethodName.auto,
    workers: Annotated[int | None, typer.Option(help="Runs at a time; by default one a core.", min=1)] = None,
    png: Annotated[
        Path | None, typer.Option(help="The picture, for one or two keys; by default beside the table.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="tcp://HOST:PORT", help="Run on the workers of this Dask scheduler.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace table and picture that are there.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of lines.")] = False,
) -> None:
    """Run thousands of variations of a scene over all cores; write a table and a picture.

    crawler sweep ten_contact_wave --vary friction.forward=0.1:1:50 --vary body.links.stiffness=10,20 --out f.parquet

    A key is the way to a number in the scene file: friction.forward, drive.wave.amplitude, body.links.stiffness.0 (the
    first link). A row holds the numbers varied, the net translation in the last period, energies, and whether the
    answer is unique; invalid variations say why. Ctrl-C keeps what is done.
    """
    from crawler_model.sweep.many import Settings

    from . import sweep as sweeps

    settings = Settings(duration, rate, None if method is MethodName.auto else method.value)  # type: ignore[arg-type]
    plan = sweeps.plan_sweep(load_scene(scene), vary, settings, out, png, overwrite)
    with progress_bar("sweeping") as progress:
        runs = sweeps.run_sweep(plan, workers, scheduler, progress)
    print(json.dumps(sweeps.summarise(plan, runs)) if as_json else "\n".join(sweeps.describe_sweep(plan, runs)))
    if runs.interrupted:
        raise typer.Exit(130)


app.command()(view)
app.command("replay")(replay)
app.command("compare")(compare)


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder in which recording, .rrd and .png are left.")] = Path("demo"),
) -> None:
    """Watch a three-contact crawler walk: two ROS 2 processes, a recording, a picture, a summary."""
    from .demo import run_demo

    with progress_bar("walking") as progress:
        summary = run_demo(out, progress)
    print("\n".join(summary))


app.command()(bench)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command; every expected error is one line on standard error.

    Args:
        arguments: the verb and what follows; None for the process's own.
    """
    try:
        status = app(arguments, prog_name="crawler", standalone_mode=False)
    except typer.Exit as error:
        status = error.exit_code
    except _UsageError as error:
        verb = f" {error.ctx.info_name}" if error.ctx is not None and error.ctx.parent is not None else ""
        text = " ".join(error.format_message().split())
        if "No such command" in text and "Did you mean" not in text:
            text += f" There are {', '.join(sorted(error.ctx.command.list_commands(error.ctx)))}."
        print(f"crawler: {text} (see crawler{verb} --help)", file=sys.stderr)
        status = 2
    except (CrawlerError, OSError) as error:
        print(f"crawler: {' '.join(str(error).split())}", file=sys.stderr)
        status = 1
    except ModuleNotFoundError as error:
        print(f"crawler: {describe_missing(error)}", file=sys.stderr)
        status = 1
    except (KeyboardInterrupt, typer.Abort):
        status = STOPPED
    if status == STOPPED:  # typer's answer to Ctrl-C, too
        print("crawler: stopped", file=sys.stderr)
    sys.exit(status or 0)


if __name__ == "__main__":
    main()
