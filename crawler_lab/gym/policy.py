"""Policies: functions from an observation to an action, by name or from an ONNX file."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model import CrawlerError

Policy = Callable[[np.ndarray], Any]
"""From an observation, float64, shape (O,), to an action, shape (A,)."""


def load_policy(name: str) -> Policy:
    """Load a policy.

    Args:
        name: `module:function`, also with modules of the working directory, or the path of a file that ends with
            .onnx.

    Returns:
        The policy.

    Raises:
        CrawlerError: if there is no such policy.
    """
    if name.endswith(".onnx"):
        return _load_onnx(Path(name))
    module, _, function = name.partition(":")
    if not module or not function:
        raise CrawlerError(f"policy: {name!r}; it must be module:function, or the path of an .onnx file")
    here = os.getcwd()
    if here not in sys.path:
        sys.path.insert(0, here)
    try:
        found: Any = importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module}.".startswith(f"{error.name}."):
            raise
        raise CrawlerError(f"policy: {name!r}; there is no module {module!r} here ({here}) or installed") from None
    for step in function.split("."):
        found = getattr(found, step, None)
    if not callable(found):
        raise CrawlerError(f"policy: {name!r}; {module} has no function {function!r}")
    return found  # type: ignore[no-any-return]


def _load_onnx(path: Path) -> Policy:
    try:
        runtime = importlib.import_module("onnxruntime")
    except ModuleNotFoundError:
        raise CrawlerError("policy: onnxruntime is not installed; pip install onnxruntime") from None
    if not path.is_file():
        raise CrawlerError(f"policy: {path}: there is no such file")
    options = runtime.SessionOptions()
    options.intra_op_num_threads = 1  # so that sums are added in one order
    try:
        session = runtime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors have no common type
        raise _explain(path, error) from None
    entry = session.get_inputs()[0]
    kind = np.float64 if entry.type == "tensor(double)" else np.float32

    def policy(observation: np.ndarray) -> np.ndarray:
        try:
            (action, *_) = session.run(None, {entry.name: observation[None].astype(kind)})
        except Exception as error:  # above all a network for observations of another scene
            raise _explain(path, error) from None
        return np.asarray(action, dtype=np.float64)[0]

    return policy


def _explain(path: Path, error: Exception) -> CrawlerError:
    return CrawlerError(f"policy: {path}: {' '.join(str(error).split())[:200]}")
