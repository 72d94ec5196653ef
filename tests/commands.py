"""The `crawler` command in the process of a test, whose kernels and libraries are loaded: a process takes seconds."""

from __future__ import annotations

import contextlib
import io
import subprocess
from pathlib import Path

import pytest

from crawler_command.app import main


def crawler(*arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command where there is no display and no terminal; return its status and what it printed."""
    words, out, errors = [str(word) for word in arguments], io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
        for name in ("DISPLAY", "WAYLAND_DISPLAY"):
            patch.delenv(name, raising=False)
        patch.setenv("COLUMNS", "120")
        if cwd is not None:
            patch.chdir(cwd)
        with pytest.raises(SystemExit) as left:
            main(words)
    return subprocess.CompletedProcess(words, int(left.value.code or 0), out.getvalue(), errors.getvalue())
