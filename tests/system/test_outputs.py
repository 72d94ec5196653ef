"""What commands print and write where the disk is full, or the terminal lacks letters."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml

from crawler_command.screen import whole_file
from crawler_model import CrawlerError, load_scene, prepare

from ..commands import crawler
from ..recordings import record

ROOM = 2048
"""Bytes of a file on a disk that is nearly full."""


@contextmanager
def nearly_full():
    """Let no file be larger than that, so that each ends in its middle; Python ignores the signal."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


WRITING = {
    "check --png": ("check", "two_anchor_a", "--png", "{}/x.png"),
    "simulate --png": ("simulate", "two_anchor_a", "--png", "{}/x.png"),
    "simulate --csv": ("simulate", "two_anchor_a", "--csv", "{}/x.csv"),
    "simulate --parquet": ("simulate", "two_anchor_a", "--parquet", "{}/x.parquet"),
    "sweep --out": ("sweep", "two_anchor_a", "--vary", "body.links.stiffness=1:2:99", "--out", "{}/x.parquet"),
    "animate --out": ("animate", "two_anchor_a", "--out", "{}/x.gif", "--duration", "0.1"),
}


@pytest.mark.parametrize("words", WRITING.values(), ids=WRITING)
def test_on_a_disk_that_becomes_full_the_error_names_the_file(tmp_path, words):
    pytest.importorskip("pyarrow")
    pytest.importorskip("matplotlib")
    given = [word.format(tmp_path) for word in words]
    (file,) = (word for word in given if word.startswith(str(tmp_path)))
    prepare(load_scene("two_anchor_a"))  # or its kernels would not fit, either
    with nearly_full():
        done = crawler(*given)
    assert done.returncode == 1
    assert done.stderr == f"crawler: {file}: cannot be written: File too large\n"
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def full(tmp_path):
    """A full file system."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(folder)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("only root can mount a file system")
    (folder / "rest").write_bytes(bytes(64 << 10))
    yield folder
    subprocess.run(["umount", "--lazy", str(folder)], check=True)  # pyarrow holds a file that it could not end


@pytest.mark.parametrize("name", ["x.png", "x.csv", "x.parquet"])
def test_on_a_full_disk_the_error_names_the_file(full, name):
    pytest.importorskip("pyarrow")
    pytest.importorskip("matplotlib")
    done = crawler("simulate", "two_anchor_a", f"--{name[2:]}", full / name)
    assert (done.returncode, done.stderr) == (
        1,
        f"crawler: {full / name}: cannot be written: No space left on device\n",
    )
    assert [file.name for file in full.iterdir()] == ["rest"]


@pytest.mark.parametrize("option", ["--rrd", "--parquet", "--png"])
def test_what_replay_writes_to_a_full_disk_is_named(full, tmp_path, option):
    for library in ("rerun", "pyarrow", "matplotlib"):
        pytest.importorskip(library)
    recording = record(tmp_path / "bag", "two_anchor_a", 1.0)
    out = full / ("tables" if option == "--parquet" else f"x.{option[2:]}")
    done = crawler("replay", recording, option, out)
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]  # the first start compiles kernels, with a line about it
    assert last.startswith(f"crawler: {out}")
    assert "No space left on device" in last
    assert [file.name for file in full.iterdir() if not file.is_dir()] == ["rest"]


def test_a_full_temporary_disk_is_named(full, tmp_path, monkeypatch):
    zstandard = pytest.importorskip("zstandard")
    (part,) = record(tmp_path / "bag", "two_anchor_a", 1.0).glob("*.mcap")
    packed = tmp_path / "packed.mcap"
    packed.write_bytes(zstandard.compress(part.read_bytes()))
    monkeypatch.setattr(tempfile, "tempdir", str(full))
    done = crawler("replay", packed)
    assert done.returncode == 1
    assert f"if it is the disk of the temporary folder {full}, name another with TMPDIR\n" in done.stderr


def test_an_error_of_another_file_names_that_one(tmp_path):
    with pytest.raises(FileNotFoundError, match="elsewhere"), whole_file(tmp_path / "x.png"):
        (tmp_path / "folder" / "elsewhere").read_bytes()
    missing = tmp_path / "none" / "x.png"
    with pytest.raises(CrawlerError, match=r"none/x\.png: cannot be written: No such file"), whole_file(missing):
        pass


CHINESE = "蠕虫 é"
PRINTING = {
    "check": ("check", "{scene}"),
    "check --json": ("check", "{scene}", "--json"),
    "simulate": ("simulate", "{scene}"),
    "simulate --json": ("simulate", "{scene}", "--json"),
    "sweep": ("sweep", "{scene}", "--vary", "body.links.stiffness=1,2", "--out", "{folder}/out.parquet"),
    "an error": ("check", "{folder}/蠕虫.yaml"),
    "a usage error": ("蠕虫",),
}
ENCODINGS = (
    {"LC_ALL": "C"},
    {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"},
    {"PYTHONIOENCODING": "ascii"},
)


@pytest.mark.parametrize("setting", ENCODINGS, ids=lambda setting: " ".join(f"{k}={v}" for k, v in setting.items()))
def test_text_that_the_terminal_lacks_is_replaced(tmp_path, setting):
    """All commands in one process, which takes seconds to load."""
    document = load_scene("two_anchor_a").document() | {"name": CHINESE}
    scene = tmp_path / "scene.yaml"
    scene.write_text(yaml.safe_dump(document, allow_unicode=True), encoding="utf-8")
    calls = [[word.format(scene=scene, folder=tmp_path).encode() for word in words] for words in PRINTING.values()]
    code = (
        "import os\nfrom crawler_command.app import main\n"
        f"for words in {calls}:\n"
        "    try:\n        main([*map(os.fsdecode, words)])\n"
        "    except SystemExit as left:\n        print('status', left.code, flush=True)\n"
    )
    environment = os.environ | setting | ({} if "PYTHONIOENCODING" in setting else {"PYTHONIOENCODING": ""})
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True)
    shown = done.stdout.decode("utf-8")
    assert done.returncode == 0, done.stderr
    assert [line.split()[1] for line in shown.splitlines() if line.startswith("status")] == list("0000012")
    assert b"Traceback" not in done.stderr
    assert CHINESE in shown or "?? ?" in shown


def test_a_name_of_a_file_that_is_no_text_is_replaced(tmp_path):
    name = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xff.yaml"))
    name.write_text(yaml.safe_dump(load_scene("two_anchor_a").document()))
    words = [sys.executable, "-m", "crawler_command.app", "check", name, "--png", name.with_suffix(".png")]
    done = subprocess.run(words, env=os.environ | {"PYTHONIOENCODING": "utf-8"}, capture_output=True)
    assert done.returncode == 0, done.stderr
    assert b"drawn: " in done.stdout
