"""A cache of kernels that is damaged, full or not writable costs compiling again, and nothing else."""

from __future__ import annotations

import fcntl
import importlib.util
import multiprocessing
import pickle
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba import config

from crawler_model import kernel_cache

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")

PROBE = """
from crawler_model.compiled import compiled, inner

@inner
def plus(x):
    return x + 1

@compiled
def twice(x):
    return plus(x) * 2

@compiled
def thrice(x):
    return plus(x) * 3
"""
RESULTS = [4, 6, 3.0]


def truncated(content: bytes) -> bytes:
    return content[: len(content) // 2]


def flipped(content: bytes) -> bytes:
    """One wrong byte, in the machine code where there is some."""
    place = 3 * len(content) // 4
    return content[:place] + bytes([content[place] ^ 255]) + content[place + 1 :]


DAMAGES = {
    "empty": lambda content: b"",
    "half": truncated,
    "garbage": lambda content: bytes(range(256)) * (len(content) // 256 + 1),
    "wrong pickle": lambda content: pickle.dumps(("0.68.1", {})),
    "numba's own": lambda content: pickle.dumps("0.68.1") + pickle.dumps(("stamp", {})),
    "one byte": flipped,
    "longer": lambda content: content + b"\0",
}


@pytest.fixture
def ask(tmp_path, monkeypatch, capsys):
    """Import two small kernels anew and call them; return their results, the hits of the cache and standard error."""
    probe = tmp_path / "probe.py"
    probe.write_text(PROBE)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)

    def run(cache: Path = tmp_path / "cache") -> tuple[list[float], int, str]:
        monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
        for memory in (kernel_cache.folder_of_kernels, kernel_cache._print_once):
            memory.cache_clear()
        spec = importlib.util.spec_from_file_location("probe", probe)
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, "probe", module)
        spec.loader.exec_module(module)
        results = [module.twice(1), module.thrice(1), module.twice(0.5)]
        hits = sum(sum(kernel.stats.cache_hits.values()) for kernel in (module.twice, module.thrice))
        return results, hits, capsys.readouterr().err

    yield run
    kernel_cache.folder_of_kernels.cache_clear()


def files(folder: Path, pattern: str) -> list[Path]:
    found = sorted(folder.rglob(pattern))
    assert found
    return found


@pytest.mark.parametrize("pattern", ["*.nbi", "*.nbc", "*.nb?"])
@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_file_is_compiled_again_and_overwritten(ask, tmp_path, damage, pattern):
    assert ask() == (RESULTS, 0, "")
    assert ask() == (RESULTS, 3, "")
    for file in files(tmp_path / "cache", pattern):
        file.write_bytes(damage(file.read_bytes()))
    assert ask() == (RESULTS, 0, "")
    assert ask() == (RESULTS, 3, "")


@pytest.mark.parametrize("pattern", ["*.nbi", "*.nbc"])
def test_a_file_of_another_kernel_is_not_used(ask, tmp_path, pattern):
    ask()
    twice, thrice = ([f for f in files(tmp_path / "cache", pattern) if name in f.name] for name in ("twice", "thrice"))
    shutil.copy(thrice[0], twice[0])
    assert ask() == (RESULTS, 2 if pattern == "*.nbc" else 1, "")
    assert ask() == (RESULTS, 3, "")


def test_of_processes_that_need_a_kernel_at_once_one_compiles_it(ask):
    processes = multiprocessing.get_context("fork")
    barrier, found = processes.Barrier(4), processes.Queue()

    def need() -> None:
        barrier.wait()
        found.put(ask()[:2])

    children = [processes.Process(target=need) for _ in range(4)]
    for child in children:
        child.start()
    results, hits = zip(*(found.get() for _ in children), strict=True)
    for child in children:
        child.join()
    assert list(results) == 4 * [RESULTS]
    assert sum(hits) == 3 * 3  # of four processes with three kernels each


def test_a_kernel_that_another_process_keeps_between_a_look_and_the_turn_is_not_compiled_again(ask, monkeypatch):
    ask()
    look, signatures = kernel_cache.KernelCache._load_overload, set()

    def miss_once(cache: kernel_cache.KernelCache, sig: tuple, target_context: object) -> object:
        if (cache, sig) in signatures:
            return look(cache, sig, target_context)
        signatures.add((cache, sig))
        return None

    monkeypatch.setattr(kernel_cache.KernelCache, "_load_overload", miss_once)
    assert ask() == (RESULTS, 3, "")


def test_a_process_that_stops_while_it_compiles_does_not_keep_others_for_ever(ask, tmp_path, monkeypatch):
    ask()
    locks = [lock.open("w") for lock in files(tmp_path / "cache", "*.lock")]
    for lock in locks:
        fcntl.flock(lock, fcntl.LOCK_EX)
    for file in files(tmp_path / "cache", "*.nbi"):
        file.unlink()
    monkeypatch.setattr(kernel_cache, "_PATIENCE_S", 0.1)
    assert ask() == (RESULTS, 0, "")


def test_data_of_other_types_are_not_used(ask, tmp_path):
    """Two processes that compile at once may give their data the same name; the last one stays."""
    ask()
    first, second = (f for f in files(tmp_path / "cache", "*.nbc") if "twice" in f.name)
    shutil.copy(first, second)
    assert ask() == (RESULTS, 2, "")
    assert ask() == (RESULTS, 3, "")


def test_a_missing_file_is_compiled_again(ask, tmp_path):
    ask()
    for file in files(tmp_path / "cache", "*.nbc"):
        file.unlink()
    assert ask() == (RESULTS, 0, "")
    assert ask() == (RESULTS, 3, "")


def no_folder(cache: Path) -> None:
    cache.write_text("a file in the place of the folder")


def no_kernels(cache: Path) -> None:
    cache.mkdir()
    (cache / "crawler").write_text("")


@pytest.mark.parametrize("spoil", [no_folder, no_kernels])
def test_without_a_folder_kernels_stay_in_memory(ask, tmp_path, spoil):
    cache = tmp_path / "spoilt"
    spoil(cache)
    check_unkept(ask(cache), cache, "Not a directory")


def check_unkept(answer: tuple[list[float], int, str], cache: Path, reason: str) -> None:
    results, hits, errors = answer
    assert (results, hits) == (RESULTS, 0)
    (line,) = errors.splitlines()
    assert line.startswith(f"crawler: compiled kernels cannot be kept in {cache}/crawler/kernels/")
    assert f": {reason}; every run compiles them again" in line


def test_on_a_disk_that_becomes_full_kernels_stay_in_memory(ask, tmp_path):
    """No file may be larger than 2 KiB, so that it ends in the middle; Python ignores the signal."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2048, before[1]))
    try:
        answer = ask()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    check_unkept(answer, tmp_path / "cache", "File too large")
    assert not list((tmp_path / "cache").rglob("*.tmp*"))
    assert ask() == (RESULTS, 0, "")
    assert ask() == (RESULTS, 3, "")


@pytest.fixture
def mounted(tmp_path):
    """Mount a file system of 64 KiB; return its folder and what mounts it read-only."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(folder)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("only root can mount a file system")
    yield folder, lambda: subprocess.run(["mount", "-o", "remount,ro", str(folder)], check=True)
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


def test_on_a_full_disk_kernels_stay_in_memory(ask, mounted):
    folder, _ = mounted
    size = subprocess.check_output(["df", "--output=avail", "-B1", folder], text=True)
    (folder / "rest").write_bytes(bytes(int(size.split()[1])))
    check_unkept(ask(folder), folder, "No space left on device")


def test_on_a_disk_that_is_read_only_kernels_stay_in_memory(ask, mounted):
    folder, lock = mounted
    lock()
    check_unkept(ask(folder), folder, "Read-only file system")


def test_a_cache_that_is_read_only_is_read(ask, tmp_path, mounted):
    folder, lock = mounted
    ask()
    shutil.copytree(tmp_path / "cache", folder, dirs_exist_ok=True)
    lock()
    assert ask(folder) == (RESULTS, 3, "")
