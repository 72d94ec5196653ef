"""The console, progress bar, options and checks that the verbs share."""

from __future__ import annotations

import importlib.util
import os
import signal
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol

import typer
from rich.cells import cell_len
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from crawler_model import CrawlerError

from .executables import describe_missing

if TYPE_CHECKING:
    from types import FrameType

    from crawler_model import Scene


class Screen(Console):
    """A console on which a table whose numbers would be cut turns on its side.

    Names and paths may contain brackets: the only markup is `[yellow]...[/]`.
    """

    def __init__(self, **options: Any) -> None:
        """Open the console.

        Args:
            **options: options of rich's `Console`.
        """
        super().__init__(markup=False, highlight=False, **options)

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich does, but tables so that they fit, and of the markup only yellow text.

        Args:
            *objects: what to print.
            **options: options of `Console.print`.
        """
        fitting: list[Any] = []
        for one in objects:
            fitting += fit(one, self) if isinstance(one, Table) else [_colour(one) if isinstance(one, str) else one]
        super().print(*fitting, **options)


def _colour(line: str) -> Text:
    plain, *marked = line.split("[yellow]")
    text = Text(plain)
    for part in marked:
        yellow, _, after = part.partition("[/]")
        text.append(yellow, "yellow").append(after)
    return text


def fit(table: Table, screen: Console) -> list[Table]:
    """Turn a table that is wider than a screen: its columns become lines, with as many rows side by side as fit.

    Args:
        table: the table, whose cells are text.
        screen: the screen.

    Returns:
        The table, or several that hold the same.
    """
    if not any("…" in segment.text for segment in screen.render(table)):
        return [table]
    cells = [[column.header, *column.cells] for column in table.columns]
    widths = [max(cell_len(str(cell)) for cell in row) + 3 for row in zip(*cells, strict=True)]
    turned: list[Table] = []
    left = list(range(1, len(widths)))
    while left:
        count, room = 1, screen.width - widths[0] - 1 - widths[left[0]]
        while count < len(left) and widths[left[count]] <= room:
            room -= widths[left[count]]
            count += 1
        part = Table(title=None if turned else table.title, title_justify="left", show_header=False)
        for _ in range(count + 1):
            part.add_column(justify="right")
        part.columns[0].justify = "left"
        for column in cells:
            part.add_row(column[0], *(column[k] for k in left[:count]))
        turned.append(part)
        left = left[count:]
    return turned


screen = Screen(soft_wrap=not sys.stdout.isatty(), width=None if sys.stdout.isatty() else 160)
SceneArgument = Annotated[str, typer.Argument(help="A scene file, or a gallery name from `crawler scenes`.")]


class MethodName(str, Enum):
    """The method by which a tick is integrated."""

    auto = "auto"
    exact = "exact"
    catch_up = "catch_up"


ForceOption = Annotated[bool, typer.Option("--force", "--overwrite", help="Replace existing files.")]
SceneOption = Annotated[
    str | None,
    typer.Option(help="The scene that ran, a file or a gallery name, for a recording that does not hold it."),
]
NamespaceOption = Annotated[str | None, typer.Option(help="Namespace of the crawler, where several were recorded.")]
TwoColumnsOption = Annotated[
    bool, typer.Option("--two-columns", help="Draw the panels over time of --png in two columns, for print.")
]
DurationOption = Annotated[
    float | None, typer.Option(help="Simulated time, s; by default ten periods, or up to the last waypoint.")
]
MethodOption = Annotated[
    MethodName, typer.Option(help="The method of integration; auto is exact on a line, catch_up in the plane.")
]


class ShowProgress(Protocol):
    """Shows how far something is."""

    def __call__(self, part: float, step: str = "") -> None:
        """Show the fraction done, in [0, 1], and the name of the present step."""


@contextmanager
def progress_bar(what: str) -> Iterator[ShowProgress]:
    """Show a progress bar on a terminal and nothing in a pipe.

    Args:
        what: label of the bar.

    Yields:
        A function that accepts the fraction done, in [0, 1], and the name of the present step.
    """
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda part, step="": None
        return
    from crawler_model.compiled import announcer

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    with Progress(*columns, TimeRemainingColumn(), console=console, transient=True) as bar:
        task = bar.add_task(what, total=1.0)
        announcer.show = lambda text: bar.update(task, description=text or what)
        try:
            yield lambda part, step="": bar.update(task, completed=part, description=step or what)
        finally:
            announcer.show = None


PICTURES = (".png", ".pdf", ".svg")
"""The ends of the names of pictures, the last two with lines and letters instead of pixels."""
_WRITERS = {**dict.fromkeys(PICTURES, "matplotlib"), ".parquet": "pyarrow", ".csv": "pyarrow", ".rrd": "rerun"}
"""The library that writes each kind of file."""
READERS = ("mcap", "zstandard", "rosbags")
"""The libraries that read recordings."""


def is_recording(source: str) -> bool:
    """Tell a recording from a scene.

    Args:
        source: a path, or the name of a scene of the gallery.

    Returns:
        Whether it is a bag folder or a file of one, which may have a format that is not read.
    """
    from crawler_model import gallery

    return source not in gallery() and (Path(source).is_dir() or source.endswith((".mcap", ".mcap.zstd", ".db3")))


def require(*modules: str) -> None:
    """Check that libraries are installed, before anything is compiled or computed.

    Args:
        *modules: names of their modules.

    Raises:
        CrawlerError: when some are not; the message names the extras that bring them.
    """
    missing = [name for name in modules if not _is_installed(name)]
    if missing:
        raise CrawlerError(describe_missing(*missing))


def _is_installed(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:
        return False


def check_output(option: str, file: Path | None, suffixes: str | tuple[str, ...], force: bool) -> None:
    """Check that a file can be written.

    Args:
        option: the option that names it, for error messages.
        file: the file; None to write none.
        suffixes: the end that its name must have, or several of which it must have one.
        force: whether it may exist.

    Raises:
        CrawlerError: when its name has another end, its folder does not exist or is not writable, it is a folder, it
            exists and may not, or the library that writes it is not installed.
    """
    if file is None:
        return
    folder = file.absolute().parent
    known = (suffixes,) if isinstance(suffixes, str) else suffixes
    if file.suffix not in known:
        raise CrawlerError(f"{option}: {file} must end in {' or '.join(known)}")
    if not folder.is_dir():
        raise CrawlerError(f"{option}: the folder {folder} does not exist")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise CrawlerError(f"{option}: the folder {folder} is not writable")
    if file.is_dir():
        raise CrawlerError(f"{option}: {file} is a folder; it must be a file")
    if file.exists() and not force:
        raise CrawlerError(f"{option}: {file} exists already; choose another name, or use --force")
    if file.suffix in _WRITERS:
        require(_WRITERS[file.suffix])


def parse_slower_than(text: str) -> float:
    """Parse the option `--slower-than`.

    Args:
        text: an inertia number, written r=0.1.

    Returns:
        The number.

    Raises:
        CrawlerError: if it is written in another way.
    """
    try:
        return float(text.removeprefix("r="))
    except ValueError:
        raise CrawlerError(f"--slower-than {text}: write the largest inertia number, for example r=0.1") from None


def parse_bounds(option: str, texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Parse options of the form KEY=A:B; a bare A:B has the key "".

    Args:
        option: name of the option, for error messages.
        texts: its values.

    Returns:
        The two numbers of each key.

    Raises:
        CrawlerError: with one line that describes the correct form.
    """
    found: dict[str, tuple[float, float]] = {}
    for text in texts:
        key, equals, spec = text.rpartition("=")
        form = "A:B or NAME=A:B" if option == "--stroke" else "KEY=A:B"
        if not equals and option != "--stroke":
            raise CrawlerError(f"{option} {text}: write {form}")
        parts = spec.split(":")
        try:
            numbers = [float(part) for part in parts]
        except ValueError:
            numbers = []
        if len(numbers) != 2:
            raise CrawlerError(f"{option} {text}: write {form}, with two numbers")
        if key.strip() in found:
            raise CrawlerError(f"{option} {text}: {key.strip() or 'the stroke'} is repeated")
        found[key.strip()] = numbers[0], numbers[1]
    return found


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Write a file completely or not at all.

    Args:
        path: final path of the file.

    Yields:
        The temporary path to write to.

    Raises:
        KeyboardInterrupt: after Ctrl-C, also where a library raises another error because of it.
    """
    with named_errors(path):
        handle, name = tempfile.mkstemp(suffix=path.suffix, prefix=f".{path.stem}_", dir=path.absolute().parent)
        os.close(handle)
        part = Path(name)
        try:
            with _plain_interrupts():
                yield part
            mask = os.umask(0)
            os.umask(mask)
            part.chmod(0o666 & ~mask)
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)


@contextmanager
def named_errors(path: Path) -> Iterator[None]:
    """Name the file or folder that is being written in errors, as of a full disk; libraries name none.

    Args:
        path: the file or folder.

    Raises:
        CrawlerError: when it cannot be written.
    """
    try:
        yield
    except OSError as error:
        if isinstance(error.filename, str) and Path(error.filename).absolute().parent != path.absolute().parent:
            raise  # of another file, which it names
        reason = os.strerror(error.errno) if error.errno else error
        raise CrawlerError(f"{path}: cannot be written: {reason}") from None


@contextmanager
def _plain_interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt after Ctrl-C where matplotlib's compiled code makes a ValueError or a TypeError of it."""
    before, pressed = signal.getsignal(signal.SIGINT), False
    if not callable(before):  # ignored, as in the background of a script
        yield
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal pressed
        pressed = True
        before(number, frame)

    signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    except Exception:
        if pressed:
            raise KeyboardInterrupt from None
        raise
    finally:
        signal.signal(signal.SIGINT, before)


def note_left_out(scene: Scene, drive: Mapping[str, Any]) -> None:
    """Print which commands of a scene's drive are missing from the drive that was sought in its place.

    Args:
        scene: the scene.
        drive: the part `drive` of the scene that was found.
    """
    own = scene.document().get("drive", {})
    for kind, keys in {"friction": ("friction", "friction_wave"), "loads": ("loads",)}.items():
        left_out = [f"drive.{key}" for key in keys if key in own]
        if left_out and drive.keys().isdisjoint(keys):
            text = f"the drive was sought without {' and '.join(left_out)}, on the {kind} of the scene itself"
            print(f"crawler: {scene.name}: {text}", file=sys.stderr)


def write_scene(scene: Scene, path: Path, notes: Sequence[str] = ()) -> None:
    """Write a scene to a file, completely or not at all.

    Args:
        scene: the scene.
        path: the .yaml file.
        notes: comments above the scene, a line each.
    """
    import yaml

    text = yaml.safe_dump(scene.document(), sort_keys=False, default_flow_style=None, allow_unicode=True)
    with whole_file(path) as part:
        part.write_text("".join(f"# {note}\n" for note in notes) + text, encoding="utf-8")
