"""Mutants: small wrong changes of the code, one at a time, and whether the tests notice them (`make mutants`).

Each package gets a share that grows with the root of its size, spread evenly over its rooms. A mutant is tested in a
copy of the tree, first by the test files that are nearest to its module: by the words that their paths share, and by
the number of imports between them; of each test by one case before the others. Its fate is one of three:

* killed: a test fails that passes without the change, or never ends;
* survived: the nearest test files pass (`--files`), which leaves tests that are slow or were skipped;
* undecided: the time ended first, which says nothing about the tests that were left.

Kernels run interpreted at first, which takes less than to compile them, and compiled where the time has ended so.
A run that was interrupted goes on where it ended, by what it has written to `mutants/`.
"""

from __future__ import annotations

import argparse
import ast
import inspect
import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

from .mutations import Mutant, choose

ROOT = Path(__file__).parent.parent
STAGES = (2, 8)
"""Numbers of the nearest test files that a mutant is tested with at first: to import them takes a second each."""
LIMIT, WORDS = "MUTANT_SECONDS", "MUTANT_WORDS"
OF_TEXT = {"test_structure.py", "test_rooms.py", "test_documented_names.py"}
"""Tests that read the sources and not what they do."""
SAME_KERNELS = """
_hash_here = _hash_files
def _hash_files(folder, patterns):  # a change outside the kernels leaves their cache valid
    return _hash_here(Path(str(folder).replace({copy!r}, {clean!r})), patterns)
"""


def pytest_configure() -> None:
    """End a run when its time on the processor has passed, and close what the tests opened (this file is a plugin)."""
    if LIMIT in os.environ:
        seconds = int(os.environ.pop(LIMIT))
        signal.signal(signal.SIGXCPU, signal.default_int_handler)
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 30))


def pytest_collection_modifyitems(items: list) -> None:
    """Run the tests first that share words with the mutant, and of each test one case, then a second one, then all."""
    words = os.environ.pop(WORDS, "").split()
    seen: Counter[str] = Counter()
    rank = {}
    for item in items:
        name = item.nodeid.partition("[")[0]
        seen[name] += 1
        text = name + inspect.getsource(item.function)
        rank[item] = min(seen[name], 3), -sum(word in text for word in words)
    items.sort(key=lambda item: rank[item])


def imports(root: Path) -> dict[str, set[str]]:
    """Find which files of packages and tests each of them imports or names, past packages that only pass names on."""
    tops = [init.parent for init in root.glob("*/__init__.py")]
    files = {str(path.relative_to(root)): path for top in tops for path in top.rglob("*.py")}
    file_of = {file.removesuffix(".py").removesuffix("/__init__").replace("/", "."): file for file in files}
    trees = {file: ast.parse(path.read_bytes()) for file, path in files.items()}

    def targets(file: str, node: ast.AST) -> Iterator[tuple[str, str]]:
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = file.split("/")[: -node.level] if node.level else []
            yield from ((".".join([*base, *filter(None, [node.module])]), alias.name) for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in file_of:
            yield node.value, ""

    def origin(module: str, name: str) -> str | None:
        file = file_of.get(f"{module}.{name}", file_of.get(module))
        passed_on = exports.get((file, name))
        return file if passed_on in (None, (module, name)) else origin(*passed_on)

    each = {file: [t for node in ast.walk(tree) for t in targets(file, node)] for file, tree in trees.items()}
    exports = {
        (file, name): (module, name) for file in each if "__init__" in file for module, name in each[file] if name
    }
    return {file: {f for t in found if (f := origin(*t))} for file, found in each.items()}


def order_tests(mutant: Mutant, graph: dict[str, set[str]], root: Path) -> list[str]:
    """List the test files that import a module, the nearest first."""
    distance, edge = {mutant.file: 0}, {mutant.file}
    while edge:
        edge = {f for f, those in graph.items() if those & edge} - distance.keys()
        distance |= dict.fromkeys(edge, max(distance.values()) + 1)

    def words(path: str) -> set[str]:
        return set(re.split(r"[/_.]", path)) - {"crawler", "tests", "test", "py", "init", ""}

    def rank(file: str) -> tuple[float, str]:
        named = re.search(rf"\b({mutant.function}|{Path(mutant.file).stem})\b", (root / file).read_text("utf-8"))
        return distance[file] - 2 * len(words(file) & words(mutant.file)) - 2 * bool(named), file

    return sorted((f for f in distance if Path(f).name.startswith("test_") and Path(f).name not in OF_TEXT), key=rank)


def run(folder: Path, words: list[str], seconds: float, way: dict[str, str]) -> tuple[int, str]:
    """Run pytest for some seconds of a processor, and at most five times as long; return its status and output."""
    command = [sys.executable, "-m", "pytest", "-p", "tests.mutants", "-p", "no:cacheprovider", "-x", "-v", "--tb=no"]
    environment = os.environ | {"PYTHONPATH": str(folder), "COLUMNS": "1000", LIMIT: str(round(seconds))} | way
    with tempfile.TemporaryFile("w+") as out:
        process = subprocess.Popen(
            [*command, "-m", "not slow", *words],
            cwd=folder,
            env=environment,
            stdout=out,
            stderr=out,
            start_new_session=True,
        )
        for number, patience in ((signal.SIGINT, 5.0 * seconds), (signal.SIGKILL, 30.0)):
            try:
                process.wait(patience)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, number)
        out.seek(0)
        return process.wait(), out.read()


def try_out(mutant: Mutant, folder: Path, tests: list[str], seconds: float, sound: dict[str, bool]) -> None:
    """Apply a mutant in a copy of the tree, run its tests, and note its fate."""
    path, cache, begun = folder / mutant.file, folder / ".kernels", time.monotonic()
    whole = path.read_bytes()
    changed = whole[: mutant.place[0]] + mutant.after.encode() + whole[mutant.place[1] :]
    words = {word for part in (mutant.function, path.stem) for word in part.split("_") if len(word) > 2}
    compiled = {WORDS: " ".join(words)} | ({"NUMBA_CACHE_DIR": str(cache)} if mutant.kernel else {})
    ways = [(compiled | {"NUMBA_DISABLE_JIT": "1"}, seconds), (compiled, 3.0 * seconds)][not mutant.kernel :]
    fate = "survived"
    for files in filter(None, (tests[a:b] for a, b in zip((0, *STAGES), (*STAGES, None), strict=True))):
        unsound, left = list[str](), list(ways)
        while left and fate != "killed":
            way, limit = left[0]
            own = {k: v for k, v in way.items() if k != "NUMBA_CACHE_DIR"}  # without the kernels of the mutant
            path.write_bytes(changed)
            status, said = run(folder, [*unsound, *files], limit, way)
            path.write_bytes(whole)
            failed = re.search(r"^(?:FAILED|ERROR) (tests/.*?\.py(?:::.*?)?)(?: - .*)?$", said, re.M)
            if status in (-signal.SIGSEGV, -signal.SIGABRT):
                fate, mutant.test = "killed", "Python crashed"
            elif status in (1, 2) and failed and "KeyboardInterrupt" not in said:
                test = failed[1]
                if test not in sound:
                    sound[test] = run(folder, [test], 300.0, own)[0] in (0, 5)
                if sound[test]:
                    fate, mutant.test = "killed", test
                unsound.append(f"--deselect={test}")
            else:
                left = left[1:] if status not in (0, 5) else []
                hung = re.search(r"^(tests/\S+?::.*) $", said, re.M)  # a test without a result
                compiles = mutant.kernel and way is compiled  # which may take all of the time
                if hung and not compiles and run(folder, [hung[1]], 0.3 * limit, own)[0] == 0:
                    path.write_bytes(changed)
                    if run(folder, [hung[1]], limit, way)[0] != 0:
                        fate, mutant.test = "killed", f"{hung[1]} does not end"
                    path.write_bytes(whole)
                if status not in (0, 5) and not left and fate != "killed":
                    fate = "undecided"
                if not left:
                    counts = re.findall(r"\d+ (?:passed|deselected|skipped)", said.rpartition("\n\n")[2])
                    reasons = sorted(set(re.findall(r"^SKIPPED \[\d+\] \S+ (.*)$", said, re.M)))
                    mutant.not_run += "; ".join([", ".join(counts) or f"ended with status {status}", *reasons]) + ". "
    shutil.rmtree(cache, ignore_errors=True)
    mutant.fate, mutant.seconds = fate, round(time.monotonic() - begun, 1)


def take_over(mutants: list[Mutant], folder: Path) -> None:
    """Give mutants the fates that an earlier run has found for them."""

    def key(mutant: Mutant) -> str:
        return f"{mutant.file} {mutant.place[0]} {mutant.before} {mutant.after}"

    if (folder / "mutants.json").exists():
        kept = json.loads((folder / "mutants.json").read_text("utf-8"))["mutants"]
        known = {key(m): m for m in (Mutant(**{k: v for k, v in each.items() if k != "number"}) for each in kept)}
        mutants[:] = [known.get(key(m), m) for m in mutants]


def report(mutants: list[Mutant], folder: Path, seed: int) -> str:
    """Write what became of the mutants so far, as text and as JSON."""
    lines = [f"{'package':20}{'killed':>8}{'survived':>10}{'undecided':>11}   (seed {seed})"]
    for package in sorted({m.file.split("/")[0] for m in mutants}):
        fates = Counter(m.fate for m in mutants if m.file.startswith(f"{package}/"))
        lines.append(f"{package:20}{fates['killed']:8}{fates['survived']:10}{fates['undecided']:11}")
    for m in sorted((m for m in mutants if m.fate in ("survived", "undecided")), key=lambda m: (m.fate, m.file)):
        lines += ["", f"{m.fate}: {m.file}:{m.line} in {m.function}: {m.kind}", f"  - {m.before}", f"  + {m.after}"]
        lines += [f"  {m.not_run}"]
    folder.mkdir(exist_ok=True)
    (folder / "mutants.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    numbered = [{"number": k, **asdict(m)} for k, m in enumerate(mutants)]
    (folder / "mutants.json").write_text(
        json.dumps({"seed": seed, "mutants": numbered}, indent=1) + "\n", encoding="utf-8"
    )
    return "\n".join(lines)


def main() -> None:
    """Choose mutants, try them out, and report after each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=60, help="number of mutants")
    parser.add_argument("--seed", type=int, default=0, help="of the choice")
    parser.add_argument(
        "--seconds", type=float, default=60.0, help="of a processor for each stage: the nearest tests, then others"
    )
    parser.add_argument("--files", type=int, default=24, help="number of test files, the nearest ones")
    parser.add_argument("--at-once", type=int, default=2, help="mutants that are tested at the same time")
    parser.add_argument("--packages", default=".*", help="regular expression for the names of the packages")
    parser.add_argument("--only", type=int, nargs="*", help="numbers of the mutants to try, again if need be")
    given = parser.parse_args()
    os.nice(15)
    listed = subprocess.run(
        ["git", "ls-files", "-coz", "--exclude-standard"], cwd=ROOT, capture_output=True, check=True
    )
    with tempfile.TemporaryDirectory(prefix="mutants_") as folder:
        clean, sound = Path(folder) / "clean", dict[str, bool]()
        for name in filter(None, listed.stdout.decode().split("\0")):
            (clean / name).parent.mkdir(parents=True, exist_ok=True)
            if (ROOT / name).is_file():
                shutil.copy(ROOT / name, clean / name)
        mutants, graph = choose(clean, given.count, given.seed, given.packages), imports(clean)
        copies = [Path(folder) / f"copy_{k}" for k in range(given.at_once)]
        for place in copies:
            shutil.copytree(clean, place)
            cache = next(
                p for p in (place / "crawler_model").glob("*.py") if "def _hash_files(" in p.read_text("utf-8")
            )
            with cache.open("a") as file:
                file.write(SAME_KERNELS.format(copy=str(place), clean=str(clean)))

        def one(number: int) -> None:
            mutant, place = mutants[number], copies.pop()
            mutant.fate = mutant.test = mutant.not_run = ""
            try_out(mutant, place, order_tests(mutant, graph, clean)[: given.files], given.seconds, sound)
            copies.append(place)
            report(mutants, ROOT / "mutants", given.seed)
            print(f"{number}: {mutant.fate}: {mutant.file}:{mutant.line} {mutant.kind} {mutant.test}", flush=True)

        take_over(mutants, ROOT / "mutants")
        left = [k for k, m in enumerate(mutants) if not m.fate] if given.only is None else given.only
        with ThreadPoolExecutor(given.at_once) as pool:  # a run that is interrupted has tried a fair sample
            list(pool.map(one, random.Random(given.seed).sample(left, len(left))))
    print(report(mutants, ROOT / "mutants", given.seed))


if __name__ == "__main__":
    main()
