"""Comparison of pictures with those that were looked at, which are kept small."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

GOLDEN = Path(__file__).parent / "golden"
TOLERANCE = 8.0
"""Of 255: matplotlib 3.9 is 4 to 6 away from 3.11, half the amplitude 24."""
_BLOCK = 8


def distance(drawn: Path, golden: Path) -> float:
    """Root mean square of the difference of both pictures, made small; that of another height is far."""
    wanted = Image.open(golden).convert("RGB")
    made = Image.open(drawn).convert("RGB")
    if abs(made.height / made.width - wanted.height / wanted.width) > 0.02:
        return 255.0
    size = made.width // _BLOCK, made.height // _BLOCK
    # a filter that weighs parts of pixels: sizes are not multiples of each other
    small = [np.asarray(picture.resize(size, Image.Resampling.BILINEAR), dtype=float) for picture in (made, wanted)]
    return float(np.sqrt(np.mean((small[0] - small[1]) ** 2)))


@contextlib.contextmanager
def words_of_figures() -> Iterator[list[str]]:
    """Keep what is written in each figure that is saved, in lines, which a distance does not notice.

    Numbers alone are left out, because versions of matplotlib place different ones on axes.
    """
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    kept, save = list[str](), Figure.savefig

    def save_and_keep(figure: Figure, *given: object, **more: object) -> None:
        save(figure, *given, **more)
        words = sorted(" / ".join(t.get_text().split("\n")) for t in figure.findobj(Text) if t.get_visible())
        kept.append("".join(f"{line}\n" for line in words if re.search(r"[^\W\d]", line)))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", save_and_keep)
        yield kept


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
