"""Exact rate-independent crawlers: set-valued Coulomb friction, no masses, no regularisation, no step-size error.

    0 in dR(t, xdot) + D_x E(t, x),   E = sum k/2 (z - L)^2,   R = sum mu_plus v^+ + mu_minus v^-

after P. Gidoni, "Rate-independent soft crawlers", cited as [G].
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0"

if TYPE_CHECKING:
    from .crawler.crawler import Crawler, prepare
    from .crawler.step import Certificate, Step
    from .derivative.sensitivities import Kink, Sensitivities, sensitivities
    from .errors import CommandError, CrawlerError, SceneError
    from .identify.excite import Excitation, excite
    from .identify.forecast.posterior import Posterior, read_posterior
    from .identify.forecast.predict import Forecast, predict
    from .identify.identification import Identification
    from .identify.identify import identify
    from .identify.measurements import MeasurementError, Measurements
    from .identify.sensor.sensor import Prior, Sensor
    from .optimise.optimise import optimise
    from .optimise.optimum import Optimum
    from .optimise.pareto import Front, pareto
    from .run.account import Energy
    from .run.cycle import LimitCycle, limit_cycle
    from .run.limits import Limit, largest_tow, steepest_climb
    from .run.simulate import simulate
    from .run.table import TrajectoryColumns
    from .run.trajectory import Trajectory
    from .scene.file import gallery, load_scene, parse_scene
    from .scene.scene import Scene
    from .sweep.many import simulate_many
    from .sweep.results import ManyRuns
    from .sweep.vary import Variations, vary

__all__ = [
    "Certificate",
    "CommandError",
    "Crawler",
    "CrawlerError",
    "Energy",
    "Excitation",
    "Forecast",
    "Front",
    "Identification",
    "Kink",
    "Limit",
    "LimitCycle",
    "ManyRuns",
    "MeasurementError",
    "Measurements",
    "Optimum",
    "Posterior",
    "Prior",
    "Scene",
    "SceneError",
    "Sensitivities",
    "Sensor",
    "Step",
    "Trajectory",
    "TrajectoryColumns",
    "Variations",
    "excite",
    "gallery",
    "identify",
    "largest_tow",
    "limit_cycle",
    "load_scene",
    "optimise",
    "pareto",
    "parse_scene",
    "predict",
    "prepare",
    "read_posterior",
    "sensitivities",
    "simulate",
    "simulate_many",
    "steepest_climb",
    "vary",
]

_NAMES = {
    "crawler.crawler": ("Crawler", "prepare"),
    "crawler.step": ("Certificate", "Step"),
    "derivative.sensitivities": ("Kink", "Sensitivities", "sensitivities"),
    "errors": ("CommandError", "CrawlerError", "SceneError"),
    "identify.excite": ("Excitation", "excite"),
    "identify.forecast.posterior": ("Posterior", "read_posterior"),
    "identify.forecast.predict": ("Forecast", "predict"),
    "identify.identification": ("Identification",),
    "identify.identify": ("identify",),
    "identify.measurements": ("MeasurementError", "Measurements"),
    "identify.sensor.sensor": ("Prior", "Sensor"),
    "optimise.optimise": ("optimise",),
    "optimise.optimum": ("Optimum",),
    "optimise.pareto": ("Front", "pareto"),
    "run.account": ("Energy",),
    "run.cycle": ("LimitCycle", "limit_cycle"),
    "run.limits": ("Limit", "largest_tow", "steepest_climb"),
    "run.simulate": ("simulate",),
    "run.table": ("TrajectoryColumns",),
    "run.trajectory": ("Trajectory",),
    "scene.file": ("gallery", "load_scene", "parse_scene"),
    "scene.scene": ("Scene",),
    "sweep.many": ("simulate_many",),
    "sweep.results": ("ManyRuns",),
    "sweep.vary": ("Variations", "vary"),
}
"""The public names of each module, imported when a name is first used: most programs need few of them."""
_HOMES = {name: module for module, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = globals()[name] = getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _Package(ModuleType):
    """This package, in which two names are functions, even after the folders of these names are imported."""

    identify = property(lambda self: __getattr__("identify"), lambda self, folder: None)
    optimise = property(lambda self: __getattr__("optimise"), lambda self, folder: None)


sys.modules[__name__].__class__ = _Package
