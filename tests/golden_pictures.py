"""Comparison of pictures with small copies of pictures that were looked at."""

from __future__ import annotations

import contextlib
import itertools
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GOLDEN = Path(__file__).parent / "golden"
TOLERANCE = 8.0
"""Of 255: matplotlib 3.9 is 4 to 6 away from 3.11, half the amplitude 24."""
_BLOCK = 8


def distance(drawn: Path, golden: Path) -> float:
    """Root mean square of the difference of both pictures, made small; a picture of another height is far."""
    wanted = Image.open(golden).convert("RGB")
    made = Image.open(drawn).convert("RGB")
    if abs(made.height / made.width - wanted.height / wanted.width) > 0.02:
        return 255.0
    size = made.width // _BLOCK, made.height // _BLOCK
    # a filter that weighs parts of pixels: sizes are not multiples of each other
    small = [np.asarray(picture.resize(size, Image.Resampling.BILINEAR), dtype=float) for picture in (made, wanted)]
    return float(np.sqrt(np.mean((small[0] - small[1]) ** 2)))


def _points_of(artist: Artist) -> Iterator[tuple[Any, np.ndarray]]:
    """Give the points of what is drawn on axes, each part with its colour."""
    from matplotlib.collections import Collection
    from matplotlib.image import AxesImage
    from matplotlib.lines import Line2D
    from matplotlib.quiver import Quiver
    from matplotlib.text import Annotation, Text

    if hasattr(artist, "get_data_3d"):
        yield artist.get_color(), np.transpose(artist.get_data_3d())
    elif isinstance(artist, Line2D):
        yield artist.get_color(), artist.get_xydata()
    elif isinstance(artist, Annotation):
        yield artist.get_color(), np.array([artist.xy, artist.xyann])
    elif isinstance(artist, Text):
        yield artist.get_color(), np.array([artist.get_position()])
    elif isinstance(artist, AxesImage):
        values = np.ma.filled(artist.get_array().astype(float), np.nan).reshape(-1, 1)
        yield "white", np.concatenate((values, np.reshape(artist.get_extent(), (-1, 1))))
    elif isinstance(artist, Collection):
        faces, edges = artist.get_facecolor(), artist.get_edgecolor()
        parts = [np.asarray(artist.get_offsets())] if len(artist.get_offsets()) > 1 else []
        parts = [path.vertices for path in artist.get_paths()] if len(parts) == 0 else parts
        parts += [np.column_stack((artist.U, artist.V))] if isinstance(artist, Quiver) else []
        parts = [np.zeros((0, 2))] if hasattr(artist, "do_3d_projection") else parts  # projected as a version likes
        colors = faces if len(faces) else edges
        for k, points in enumerate(parts):
            yield colors[k % len(colors)] if len(colors) else "none", points
    else:
        yield artist.get_facecolor(), artist.get_patch_transform().transform(artist.get_path().vertices)


def marks_of(figure: Figure) -> list[str]:
    """Summarise what is drawn on the axes of a figure, in their units: a line for each kind and colour.

    It has the numbers of parts and of points, and the first, the last, the least, the greatest and the mean of both
    coordinates.
    """
    from matplotlib.colors import to_hex

    found: dict[str, list[np.ndarray]] = {}
    for number, axes in enumerate(figure.axes):
        artists = [*axes.lines, *axes.patches, *axes.collections, *axes.images, *axes.texts]
        for artist in (artist for artist in artists if artist.get_visible()):
            for color, points in _points_of(artist):
                name = f"axes {number}, {type(artist).__name__} {to_hex(color, True)}"
                found.setdefault(name, []).append(np.asarray(points, float))
        legend = axes.get_legend()
        for handle in legend.legend_handles if legend else ():
            color = handle.get_facecolor() if hasattr(handle, "get_facecolor") else handle.get_color()
            found.setdefault(f"axes {number}, legend {to_hex(color, True)}", []).append(np.zeros((0, 2)))
        limits = [get() for get, free in zip((axes.get_xlim, axes.get_ylim), _are_free(axes), strict=True) if not free]
        found |= {f"axes {number}, limits": [np.transpose(limits)]} if limits else {}
    return [f"{name}: {len(parts)} of {_summarise(np.concatenate(parts))}" for name, parts in found.items()]


def _summarise(points: np.ndarray) -> str:
    """Write the number of points, and of each coordinate the first, the last, the least, the greatest and the mean."""
    known = [column[np.isfinite(column)] for column in points.T]
    numbers = [" ".join(f"{v:.5g}" for v in (v[0], v[-1], v.min(), v.max(), v.mean())) for v in known if v.size]
    return f"{len(points)}: {'; '.join(numbers)}"


def _are_free(axes: Axes) -> tuple[bool, bool]:
    return axes.get_autoscalex_on(), axes.get_autoscaley_on()


@contextlib.contextmanager
def reading_figures(read: Callable[[Figure], Iterable[str]]) -> Iterator[list[str]]:
    """Keep what `read` finds in each figure that is saved."""
    from matplotlib.figure import Figure

    kept, save = list[str](), Figure.savefig

    def save_and_keep(figure: Figure, *given: object, **more: object) -> None:
        save(figure, *given, **more)
        kept.extend(read(figure))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", save_and_keep)
        yield kept


def words_of_figures() -> contextlib.AbstractContextManager[list[str]]:
    """Keep what is written and drawn in each figure that is saved, in lines: a distance does not notice small changes.

    Bare numbers are left out, because versions of matplotlib place different ones on axes.
    """
    return reading_figures(lambda figure: [read_figure(figure)])


def crowded_pictures() -> contextlib.AbstractContextManager[list[str]]:
    """Keep the crowded words of each figure that is saved."""
    return reading_figures(crowded_words)


def read_figure(figure: Figure) -> str:
    """List what is written in a figure, and summarise what is drawn in it."""
    from matplotlib.text import Text

    words = sorted(" / ".join(t.get_text().split("\n")) for t in figure.findobj(Text) if t.get_visible())
    lines = [line for line in words if re.search(r"[^\W\d]", line)] + marks_of(figure)
    return "".join(f"{line}\n" for line in lines)


def read_rrd(file: Path) -> str:
    """Summarise what is in a file for rerun, a line for each component of each entity, in the order of time."""
    try:
        from rerun.chunk import RrdReader
    except ImportError:  # before rerun 0.41
        from rerun.experimental import RrdReader

    rows: dict[str, list[tuple[int, Any]]] = {}
    for chunk in RrdReader(str(file)).stream():
        table = chunk.to_record_batch().to_pydict()
        times = table.get("sim_time", [None] * chunk.num_rows)
        for name in (name for name in table if ":" in name and "RecordingInfo" not in name):
            at = (-1.0 if time is None else time.total_seconds() for time in times)
            rows.setdefault(f"{chunk.entity_path} {name}", []).extend(zip(at, table[name], strict=True))

    def leaves(value: Any) -> Iterator[Any]:
        if isinstance(value, list) and not (value and isinstance(value[0], float) and len(value) == 2):
            for part in value:
                yield from leaves(part)
        elif value is not None:
            yield value

    lines = []
    for name in sorted(rows):
        values = list(leaves([value for _, value in sorted(rows[name], key=lambda row: row[0])]))
        if "color" in name and len(set(values)) > 12:
            channels = np.array(values, ">u4").view(np.uint8).reshape(-1, 4)
            lines.append(f"{name}: {_summarise(channels.astype(float))}")
        elif "color" in name or not isinstance(values[0], (float, list)):
            shown = [f"{value:08x}" if type(value) is int else str(value) for value in values]
            lines.append(f"{name} {', '.join(f'{text} {count} times' for text, count in Counter(shown).items())}")
        else:
            points = np.array([value if isinstance(value, list) else [value] * 2 for value in values])
            lines.append(f"{name}: {_summarise(points if isinstance(values[0], list) else points[:, :1])}")
    return "".join(f"{line}\n" for line in lines)


def crowded_words(figure: Figure) -> list[str]:
    """List the words of a figure that leave it, and pairs of words that cover each other."""
    from matplotlib.text import Text

    figure.draw_without_rendering()
    sides = [(axes.axison, axis) for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)]
    ticks = [tick for _, axis in sides for tick in axis.get_major_ticks()]
    shown = {tick for drawn, axis in sides if drawn for tick in axis._update_ticks()}
    hidden = {label for tick in ticks if tick not in shown for label in (tick.label1, tick.label2)}
    hidden |= {axis.label for drawn, axis in sides if not drawn}
    texts = [t for t in figure.findobj(Text) if t.get_visible() and t.get_text().strip() and t not in hidden]
    boxes = [(" / ".join(text.get_text().split("\n")), text.get_window_extent().padded(-2.0)) for text in texts]
    outside = [word for word, box in boxes if not figure.bbox.containsx(box.x0) or not figure.bbox.containsx(box.x1)]
    pairs = itertools.combinations(boxes, 2)
    return outside + [f"{one} over {other}" for (one, box), (other, more) in pairs if box.overlaps(more)]


def differences(page: str, golden: Path) -> list[str]:
    """Compare what `read_figure` gave with a page that was looked at; places may differ by a thousandth of their range."""
    wanted, given = golden.read_text("utf-8").splitlines(), page.splitlines()

    def is_same(one: str, other: str) -> bool:
        if one == other:
            return True
        heads, tails = zip(*(line.rpartition(": ")[::2] for line in (one, other)), strict=True)
        if heads[0] != heads[1] or not all(re.fullmatch(r"[-+.e\d; ]+", tail) for tail in tails):
            return False
        for a, b in itertools.zip_longest(*(tail.split("; ") for tail in tails), fillvalue=""):
            x, y = (np.array(part.split(), float) for part in (a, b))
            if x.size != y.size or np.abs(x - y).max() > 1e-3 * max(np.abs(y).max(), 1e-12):
                return False
        return True

    pairs = itertools.zip_longest(given, wanted, fillvalue="(nothing)")
    return [f"{one}\n  instead of {other}" for one, other in pairs if not is_same(one, other)]


def keep(drawn: Path, golden: Path) -> None:
    """Keep a picture that was looked at, a quarter as large in few colours: `python -m tests.golden_pictures A B`."""
    if drawn.with_suffix(".txt").exists():
        golden.with_suffix(".txt").write_text(drawn.with_suffix(".txt").read_text("utf-8"), "utf-8")
    picture = Image.open(drawn).convert("RGB")
    size = 2 * (picture.width // _BLOCK), 2 * (picture.height // _BLOCK)
    small = picture.resize(size, Image.Resampling.BILINEAR)
    small.quantize(96).save(golden, optimize=True)


if __name__ == "__main__":
    import sys

    keep(Path(sys.argv[1]), Path(sys.argv[2]))
