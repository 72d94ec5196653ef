"""Every verb in an installation without extras: it works, or names what it needs before it compiles or computes."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from crawler_command.app import app
from crawler_command.executables import _EXTRA_OF

from ..pages import ROOT
from .test_start import end, start

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
    "bench": ([], "matplotlib"),
    "play": (["two_anchor_a"], "aiohttp"),
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
    "warm": ["line"],
    "excite": ["two_contacts_anisotropic", "--fit", "friction.forward", "--stroke", "-0.1:0.1", "--duration", "1"],
}
"""Verbs that need nothing more."""


def in_a_base_installation(folder: Path, *words: str, **more: str) -> tuple[int, list[str]]:
    """Run the command where only the requirements are installed."""
    return end(start(folder, "crawler", *words, NOT_INSTALLED=EXTRAS, **more))


def test_every_verb_is_walked():
    assert {*NEEDS, *WORKS, "predict"} == {*typer.main.get_command(app).commands}


@pytest.mark.parametrize("verb", WORKS)
def test_a_verb_of_the_base_works_there(verb, tmp_path):
    assert in_a_base_installation(tmp_path, verb, *WORKS[verb]) == (0, [])


def check_refusal(folder: Path, words: list[str], missing: str) -> None:
    """Run what cannot work, with no kernel in the cache."""
    (folder / "bag").mkdir()
    for name in ("m.csv", "fit.json"):
        (folder / name).touch()
    status, (line,) = in_a_base_installation(folder, *words, XDG_CACHE_HOME=str(folder), NUMBA_CACHE_DIR="")
    assert status == 1
    assert f"{missing} {'are' if ',' in missing else 'is'} not installed; " in line
    (extras,) = re.findall(r"pip install 'crawler-ros\[(.+)\]'", line)
    assert {*extras.split(",")} == {_EXTRA_OF.get(name, "ros") for name in missing.split(", ")}
    assert not any(folder.rglob("*.nbc"))  # nothing was compiled before


@pytest.mark.parametrize("verb", NEEDS)
def test_a_verb_names_what_it_needs_before_it_computes(verb, tmp_path):
    words, missing = NEEDS[verb]
    check_refusal(tmp_path, [verb, *words], missing)


@pytest.mark.parametrize("what", MORE)
def test_an_option_names_what_it_needs_before_it_computes(what, tmp_path):
    check_refusal(tmp_path, *MORE[what])


def test_importing_the_environments_without_their_library_names_the_extra(tmp_path):
    code = "import sys; sys.modules['gymnasium'] = None; import crawler_gym"
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
