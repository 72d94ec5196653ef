"""The laboratory on top of the model: derivatives, many runs, gaits, identification, learning, and a page to play.

Each folder is one use; `verbs` adds them to the command `crawler`, and `pictures` draws their results.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .derivative.sensitivities import Kink, Sensitivities, sensitivities
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
    from .sweep.many_runs import simulate_many
    from .sweep.results import ManyRuns
    from .sweep.vary import Variations, vary

__all__ = [
    "Excitation",
    "Forecast",
    "Front",
    "Identification",
    "Kink",
    "ManyRuns",
    "MeasurementError",
    "Measurements",
    "Optimum",
    "Posterior",
    "Prior",
    "Sensitivities",
    "Sensor",
    "Variations",
    "excite",
    "identify",
    "optimise",
    "pareto",
    "predict",
    "read_posterior",
    "sensitivities",
    "simulate_many",
    "vary",
]

_NAMES = {
    "derivative.sensitivities": ("Kink", "Sensitivities", "sensitivities"),
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
    "sweep.many_runs": ("simulate_many",),
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
