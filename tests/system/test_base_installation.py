"""Every verb in an installation without extras: it works, or names what it needs before it compiles or computes."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
import typer

from crawler_command.app import app
from crawler_command.executables import _EXTRA_OF

from ..pages import ROOT
from .test_start import HOOK, end, start

EXTRAS = " ".join((*_EXTRA_OF, "rclpy", "std_msgs", "sensor_msgs", "builtin_interfaces", "onnxruntime", "dask"))
FIT = ("--scene", "two_anchor_a", "--fit", "friction.forward")
NEEDS = {
    "sweep": (["two_anchor_a", "--vary", "drive.length=2,3", "--out", "s.parquet"], "pyarrow, matplotlib"),
    "optimise": (["two_anchor_a", "--for", "translation"], "cma"),
    "animate": (["two_anchor_a", "--out", "film.gif"], "matplotlib"),
    "view": (["bag", "--png", "x.png"], "rerun, mcap, zstandard, rosbags"),
    "identify": (["m.csv", *FIT], "pyarrow"),
    "replay": (["bag"], "mcap, zstandard, rosbags"),
    "compare": (["bag", "bag"], "mcap, zstandard, rosbags"),
    "demo": ([], "rclpy, mcap, zstandard, rosbags, matplotlib, rerun"),
    "play": (["two_anchor_a"], "aiohttp"),
    "run": (["two_anchor_a", "controller.py", "--record", "bags"], "rclpy, mcap, zstandard"),
    "springs": (["m.csv"], "pyarrow"),
}
"""Verbs that need more than the base, how they are called, and what is not there."""
MORE = {
    "simulate --png": (["simulate", "two_anchor_a", "--png", "x.png"], "matplotlib"),
    "simulate --csv": (["simulate", "two_anchor_a", "--csv", "x.csv"], "pyarrow"),
    "check --png": (["check", "two_anchor_a", "--png", "x.png"], "matplotlib"),
    "predict --png": (["predict", "two_anchor_a", "--from", "fit.json", "--png", "x.png"], "matplotlib"),
    "identify a bag": (["identify", "bag", *FIT], "mcap, zstandard, rosbags"),
    "animate an mp4": (["animate", "two_anchor_a", "--out", "film.mp4"], "matplotlib, av"),
    "play --ros": (["play", "two_anchor_a", "--ros"], "aiohttp, rclpy"),
    "optimise --png": (["optimise", "two_anchor_a", "--for", "travel", "--png", "x.png"], "cma, matplotlib"),
}
WORKS = {
    "simulate": ["two_anchor_a"],
    "check": ["two_anchor_a"],
    "scenes": [],
    "cite": [],
    "warm": ["line"],
    "excite": ["two_contacts_anisotropic", "--fit", "friction.forward", "--stroke", "-0.1:0.1", "--duration", "1"],
}
"""Verbs that need nothing more."""


ONE_BY_ONE = """
import contextlib, io, json, pathlib, sys
from crawler_command import executables

answers = {}
for name, words in json.loads(sys.argv[1]).items():
    sys.argv, said, status = ["crawler", *words], io.StringIO(), 0
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
        try:
            status = executables.crawler()
        except SystemExit as left:
            status = left.code or 0
    answers[name] = status, said.getvalue(), any(pathlib.Path().rglob("*.nbc"))
pathlib.Path("answers.json").write_text(json.dumps(answers))
"""
"""Runs commands one after another in one process: its status, its errors, and whether kernels lie in its folder."""


class Answer(NamedTuple):
    status: int
    said: str
    compiled: bool


def in_a_base_installation(folder: Path, commands: dict[str, list[str]], **more: str) -> dict[str, Answer]:
    """Run commands where only the requirements are installed."""
    (folder / "sitecustomize.py").write_text(HOOK)
    paths = {"PYTHONPATH": f"{folder}{os.pathsep}{ROOT}", "NOT_INSTALLED": EXTRAS}
    words = [sys.executable, "-c", ONE_BY_ONE, json.dumps(commands)]
    subprocess.run(words, cwd=folder, env=os.environ | paths | more, check=True, timeout=200)
    return {name: Answer(*found) for name, found in json.loads((folder / "answers.json").read_text()).items()}


@pytest.fixture(scope="module")
def working(tmp_path_factory) -> dict[str, Answer]:
    return in_a_base_installation(
        tmp_path_factory.mktemp("base"), {verb: [verb, *words] for verb, words in WORKS.items()}
    )


@pytest.fixture(scope="module")
def refusals(tmp_path_factory) -> dict[str, Answer]:
    """What cannot work, run with no kernel in the cache."""
    folder = tmp_path_factory.mktemp("base")
    (folder / "bag").mkdir()
    for name in ("m.csv", "fit.json"):
        (folder / name).touch()
    commands = {verb: [verb, *words] for verb, (words, _) in NEEDS.items()}
    commands |= {what: words for what, (words, _) in MORE.items()}
    return in_a_base_installation(folder, commands, XDG_CACHE_HOME=str(folder), NUMBA_CACHE_DIR="")


def test_every_verb_is_walked():
    assert {*NEEDS, *WORKS, "predict"} == {*typer.main.get_command(app).commands}


@pytest.mark.parametrize("verb", WORKS)
def test_a_verb_of_the_base_works_there(working, verb):
    assert working[verb].status == 0
    assert [line for line in working[verb].said.splitlines() if "compiling" not in line] == []


def check_refusal(status: int, said: str, missing: str) -> None:
    """Check what a command said that cannot work."""
    assert status == 1
    (line,) = said.splitlines()
    assert f"{missing} {'are' if ',' in missing else 'is'} not installed; " in line
    (extras,) = re.findall(r"pip install 'crawler-ros\[(.+)\]'", line)
    assert {*extras.split(",")} == {_EXTRA_OF.get(name, "ros") for name in missing.split(", ")}


@pytest.mark.parametrize("verb", NEEDS)
def test_a_verb_names_what_it_needs_before_it_computes(refusals, verb):
    check_refusal(refusals[verb].status, refusals[verb].said, NEEDS[verb][1])
    assert not refusals[verb].compiled


@pytest.mark.parametrize("what", MORE)
def test_an_option_names_what_it_needs_before_it_computes(refusals, what):
    check_refusal(refusals[what].status, refusals[what].said, MORE[what][1])
    assert not refusals[what].compiled


def test_the_executable_names_it_too(tmp_path):
    (tmp_path / "bag").mkdir()
    status, lines = end(start(tmp_path, "crawler", "replay", "bag", NOT_INSTALLED=EXTRAS))
    check_refusal(status, "\n".join(lines), NEEDS["replay"][1])


def test_importing_the_environments_without_their_library_names_the_extra(tmp_path):
    code = "import sys; sys.modules['gymnasium'] = None; import crawler_lab.gym"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)}
    )
    assert done.stderr.splitlines()[-1] == (
        "ModuleNotFoundError: gymnasium is not installed; install with: pip install 'crawler-ros[gym]'"
    )


def test_all_is_all_that_the_messages_name():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    (extras,) = re.findall(r'^all = \["crawler-ros\[(.+)\]"\]', text, re.M)
    assert {*extras.split(",")} >= {*_EXTRA_OF.values(), "ros"}
