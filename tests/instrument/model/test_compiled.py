"""Kernels count references to arrays correctly, although they do not count their arguments, and are compiled once."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from numba import config

from crawler_model.compiled import compiled, inlined, inner, lean

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")


@inner
def same(a):
    return a


@inner
def part(pair, k):
    first, second = pair
    if k > 0:
        first = second[k:]
    return first


@inner
def grown(a, times):
    for _ in range(times):
        a = np.concatenate((a, a))
    return a


@compiled
def use(a, b):
    kept = same(a)
    other = part((a, b), 1)
    a = grown(a, 3)
    return kept, other, a, (a, b)


def test_what_is_returned_outlives_what_it_came_from_and_nothing_else_does():
    a, b = np.arange(3.0), np.arange(5.0)
    counts = sys.getrefcount(a), sys.getrefcount(b)
    for _ in range(50):
        kept, other, longer, pair = use(a, b)
        np.testing.assert_array_equal(kept, [0.0, 1.0, 2.0])
        np.testing.assert_array_equal(other, [1.0, 2.0, 3.0, 4.0])
        np.testing.assert_array_equal(longer, np.tile([0.0, 1.0, 2.0], 8))
        np.testing.assert_array_equal(pair[0], longer)
    del kept, other, longer, pair
    assert (sys.getrefcount(a), sys.getrefcount(b)) == counts


@inner
def plus(pair, k):
    return pair[0] + pair[1] + k


@compiled
def use_constants(n):
    return plus((n, 1), 2) + plus((n, 3), n) + plus((4, 5), 6)


def test_a_kernel_is_compiled_once_for_all_constants():
    assert use_constants(10) == 13 + 23 + 15
    use_constants.recompile()  # it may have been read from the cache
    assert len(plus.signatures) == 1


@lean
def once(n):
    return n + 1


@inlined
def twice(n):
    return once(once(n))


@compiled
def use_calls(n):
    return twice(n)


def test_only_functions_that_are_marked_so_are_copied_to_where_they_are_called():
    kernels = use_calls, twice, once
    for kernel in kernels:
        kernel.recompile()  # forget what the cache holds
    assert use_calls(1) == 3
    copied = [result.fndesc.inline for kernel in kernels for result in kernel.overloads.values()]
    assert copied == [False, True, False]


MEMORY = """
from numba.core.runtime import rtsys
from crawler_lab import sensitivities
from crawler_model import Crawler, load_scene

def work():
    for name in ("two_anchor_a", "planar_rectilinear", "steering_inchworm"):
        scene = load_scene(name)
        Crawler(scene).follow(scene.drive.targets.copy())
    for name in ("two_anchor_a", "steering_inchworm"):
        sensitivities(load_scene(name), ["body.links.stiffness"])

work()
before = rtsys.get_allocation_stats()
for _ in range(3):
    work()
after = rtsys.get_allocation_stats()
print(after.alloc - before.alloc, after.free - before.free, after.mi_alloc - before.mi_alloc, after.mi_free - before.mi_free)
"""


def test_all_memory_of_kernels_is_freed():
    environment = os.environ | {"NUMBA_NRT_STATS": "1"}
    run = subprocess.run([sys.executable, "-c", MEMORY], env=environment, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    allocated, freed, arrays, freed_arrays = map(int, run.stdout.split())
    assert arrays > 100
    assert (allocated, arrays) == (freed, freed_arrays)


def test_a_compiled_kernel_leaves_numba_as_it_is_for_others(tmp_path):
    code = """
import llvmlite.binding as llvm
from numba.core import codegen, types
function, lock = types.functions.BaseFunction, llvm.ffi.lib._lock
parts = lambda: (types.Record.__repr__, function.get_call_type, codegen.create_pass_builder, lock._cblist)
theirs = parts()
from crawler_model.compiled import compiled
@compiled
def plus(a, b):
    return a + b
assert plus(1.0, 2.0) == 3.0
assert all(now is before for now, before in zip(parts(), theirs, strict=True))
"""
    script = tmp_path / "kernel.py"
    script.write_text(code)
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, env=env)
    assert done.returncode == 0, done.stderr


INTERRUPTED = """
import sys
import llvmlite.binding as llvm
from crawler_model.compiled import compiled, inner

@inner
def half(a):
    return a / 2.0

@compiled
def quarter(a):
    return half(half(a))

function = llvm.ffi._lib_fn_wrapper
call = function.__call__

def interrupted(called, *arguments):
    result = call(called, *arguments)
    if called._cfn.__name__ in sys.argv:
        raise KeyboardInterrupt
    return result

function.__call__ = interrupted
try:
    quarter(1.0)
except KeyboardInterrupt:
    print("interrupted")
"""
"""Ctrl-C arrives as soon as LLVM has taken a module over."""


@pytest.mark.parametrize("name", ["LLVMPY_LinkModules", "LLVMPY_AddModule"])
@pytest.mark.parametrize("is_cached", [False, True])
def test_ctrl_c_leaves_no_module_to_be_freed_twice(name, is_cached, tmp_path):
    script = tmp_path / "kernel.py"
    script.write_text(INTERRUPTED)
    said = ""
    for names in [[]] * is_cached + [[name]]:
        run = [sys.executable, str(script), *names]
        done = subprocess.run(run, capture_output=True, text=True, env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)})
        assert done.returncode == 0, done.stderr
        said += done.stdout
    assert said == "interrupted\n"


def test_a_kernel_is_kept_though_the_folder_of_its_cache_was_removed():
    assert use_constants(10) == 13 + 23 + 15
    shutil.rmtree(use_constants._cache.cache_path, ignore_errors=True)
    use_constants.recompile()
    assert os.listdir(use_constants._cache.cache_path)
