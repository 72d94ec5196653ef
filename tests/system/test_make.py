"""The Makefile in a folder of its own: what it makes, and what it leaves alone."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from ..pages import ROOT


@pytest.fixture
def clone(tmp_path) -> Path:
    for name in ("Makefile", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path)
    return tmp_path


def make(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["make", *words], cwd=folder, capture_output=True, text=True)


@pytest.mark.parametrize("target", ["demo", "test", "lint", "docs"])
def test_an_environment_that_make_did_not_make_is_left_alone(clone, target):
    (clone / ".venv" / "bin").mkdir(parents=True)
    (clone / ".venv" / "bin" / "python").write_text("somebody's own")
    done = make(clone, target)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert ".venv was not made by this Makefile and is left alone: choose another folder, as make demo VENV=" in line
    assert [path.name for path in (clone / ".venv").rglob("*")] == ["bin", "python"]


def test_make_clean_deletes_only_what_make_made(clone):
    for name in (".venv", ".venv-3.13", ".venv-mine"):
        (clone / name).mkdir()
    (clone / ".venv-3.13" / ".made").touch()
    done = make(clone, "clean")
    assert done.returncode == 0
    assert ".venv was not made by this Makefile and is left alone" in done.stdout
    assert sorted(path.name for path in clone.glob(".venv*")) == [".venv", ".venv-mine"]


def test_an_environment_that_make_made_is_made_again_when_the_requirements_change(clone):
    (clone / ".venv").mkdir()
    (clone / ".venv" / ".made").touch()
    os.utime(clone / ".venv" / ".made", (0, 0))
    assert "-m venv --clear .venv" in make(clone, "-n", "demo").stdout


@pytest.mark.parametrize("status", [0, 1])
def test_what_uv_cannot_install_pip_does(clone, status):
    commands = clone / ".venv" / "bin"
    commands.mkdir(parents=True)
    for name, ends in (("uv", status), ("python", 0)):
        (commands / name).write_text(f"#!/bin/sh\necho {name} $@ >> {clone}/log\nexit {ends}\n")
        (commands / name).chmod(0o755)
    (clone / ".venv" / ".made").touch()
    assert make(clone, ".venv/.ready").returncode == 0
    installed = [line.split()[0] for line in (clone / "log").read_text().splitlines() if " install " in line]
    assert installed == ["uv", "python"][: 1 + status]
