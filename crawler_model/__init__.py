"""Exact rate-independent crawlers: set-valued Coulomb friction, no masses, no regularisation, no step-size error.

    0 in dR(t, xdot) + D_x E(t, x),   E = sum k/2 (z - L)^2,   R = sum mu_plus v^+ + mu_minus v^-

after P. Gidoni, "Rate-independent soft crawlers", cited as [G].
"""

from __future__ import annotations

import importlib
import warnings
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0"

if TYPE_CHECKING:
    from .crawler.crawler import Crawler, prepare
    from .crawler.step import Certificate, Step
    from .errors import CommandError, CrawlerError, SceneError
    from .run.account import Energy
    from .run.cycle import LimitCycle, limit_cycle
    from .run.limits import Limit, largest_tow, steepest_climb
    from .run.simulate import simulate
    from .run.table import TrajectoryColumns
    from .run.trajectory import Trajectory
    from .scene.file import gallery, load_scene, parse_scene
    from .scene.scene import Scene

__all__ = [
    "Certificate",
    "CommandError",
    "Crawler",
    "CrawlerError",
    "Energy",
    "Limit",
    "LimitCycle",
    "Scene",
    "SceneError",
    "Step",
    "Trajectory",
    "TrajectoryColumns",
    "gallery",
    "largest_tow",
    "limit_cycle",
    "load_scene",
    "parse_scene",
    "prepare",
    "simulate",
    "steepest_climb",
]

_NAMES = {
    "crawler.crawler": ("Crawler", "prepare"),
    "crawler.step": ("Certificate", "Step"),
    "errors": ("CommandError", "CrawlerError", "SceneError"),
    "run.account": ("Energy",),
    "run.cycle": ("LimitCycle", "limit_cycle"),
    "run.limits": ("Limit", "largest_tow", "steepest_climb"),
    "run.simulate": ("simulate",),
    "run.table": ("TrajectoryColumns",),
    "run.trajectory": ("Trajectory",),
    "scene.file": ("gallery", "load_scene", "parse_scene"),
    "scene.scene": ("Scene",),
}
"""The public names of each module, imported when a name is first used: most programs need few of them."""
_HOMES = {name: module for module, names in _NAMES.items() for name in names}


_MOVED = (
    "Excitation Forecast Front Identification Kink ManyRuns MeasurementError Measurements Optimum Posterior Prior "
    "Sensitivities Sensor Variations excite identify optimise pareto predict read_posterior sensitivities "
    "simulate_many vary"
)
"""Names that version 0.1.0 had here, and that are now in `crawler_lab`: still found here, with a warning."""


def __getattr__(name: str) -> Any:
    if name in _MOVED.split():
        where = f"from crawler_lab import {name}"
        warnings.warn(f"crawler_model.{name} has moved: {where}", DeprecationWarning, stacklevel=2)
        return getattr(importlib.import_module("crawler_lab"), name)
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = globals()[name] = getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
