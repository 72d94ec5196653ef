"""Run the code of docs/tutorial.md and write its figures to docs/pictures/tutorial, or to another folder."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

PAGE = Path(__file__).with_suffix(".md")
PICTURES = PAGE.parent / "pictures" / "tutorial"


def run(folder: Path) -> dict[str, Any]:
    """Run the page's Python blocks one after another, as one program.

    Args:
        folder: where the figures are written.

    Returns:
        The names that are defined at the end.
    """
    text = PAGE.read_text(encoding="utf-8")
    names: dict[str, Any] = {"__name__": "tutorial"}
    with _working_in(folder):
        for block in re.finditer(r"^```python\n(.*?)^```$", text, re.S | re.M):
            line = text.count("\n", 0, block.start(1))  # errors name the page's own lines
            exec(compile("\n" * line + block.group(1), str(PAGE), "exec"), names)
    return names


@contextmanager
def _working_in(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def shrink(picture: Path) -> None:
    """Rewrite a picture in 128 colours, at a third of its size; its note of the matplotlib version is preserved."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    image = Image.open(picture)
    drawn_by = PngInfo()
    drawn_by.add_text("Software", image.info["Software"])
    image.convert("RGB").quantize(128, dither=Image.Dither.NONE).save(picture, optimize=True, pnginfo=drawn_by)


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else PICTURES
    target.mkdir(parents=True, exist_ok=True)
    run(target)
    pictures = list(target.glob("*.png"))
    for picture in pictures:
        shrink(picture)
    print(f"written: {len(pictures)} figures in {target}")
