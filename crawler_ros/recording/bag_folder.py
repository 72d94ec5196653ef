"""The folder of a recording: a new folder in a parent folder, or a one-line error with the reason."""

from __future__ import annotations

import itertools
import os
from datetime import datetime
from pathlib import Path

PATTERNS = ("*.mcap", "*.mcap.zstd")
"""Names of the files of recordings; rosbag2 compresses whole files with `--compression-mode file`."""


def check_parent(parent: Path) -> None:
    """Check that bag folders can be created in a folder, and create that folder with its parents if it does not exist.

    Args:
        parent: folder in which a bag folder is to be created.

    Raises:
        OSError: naming the folder and the reason.
    """
    try:
        parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        blocked = next((p for p in (parent, *parent.parents) if p.exists() and not p.is_dir()), None)
        reason = error.strerror if blocked is None else f"{blocked} is not a folder"
        raise OSError(f"record: {parent}: the folder cannot be created: {reason}") from None
    if not os.access(parent, os.W_OK | os.X_OK):
        raise PermissionError(f"record: {parent}: the folder is not writable")


def make_folder(parent: Path, name: str) -> Path:
    """Create a new folder with a name that nothing in the parent has, not even a dangling link.

    Args:
        parent: folder in which it is created.
        name: beginning of its name; the time follows.

    Returns:
        The folder.

    Raises:
        OSError: naming the folder and the reason.
    """
    check_parent(parent)
    stem = f"{name}_{datetime.now():%Y_%m_%d-%H_%M_%S}"
    for count in itertools.count(1):
        folder = parent / (stem if count == 1 else f"{stem}_{count}")
        try:
            folder.mkdir()
            break
        except FileExistsError:
            continue
        except OSError as error:
            raise OSError(f"record: {parent}: no folder can be created in it: {error.strerror}") from None
    return folder


def list_bags(parent: Path) -> list[Path]:
    """List the recordings in a folder.

    Args:
        parent: a folder of bag folders, or a recording.

    Returns:
        The bag folders by name; the path itself if it is a recording or holds none.
    """
    bags = sorted({file.parent for name in PATTERNS for file in parent.glob(f"*/{name}") if file.is_file()})
    is_bag = (parent / "metadata.yaml").exists()  # an .mcap file next to bag folders makes no bag of their parent
    return [parent] if is_bag or not bags else bags
