"""Exact rate-independent crawlers: set-valued Coulomb friction, no masses, no regularisation, no step-size error.

    0 in dR(t, xdot) + D_x E(t, x),   E = sum k/2 (z - L)^2,   R = sum mu_plus v^+ + mu_minus v^-

after P. Gidoni, "Rate-independent soft crawlers", cited as [G].
"""

from .crawler.crawler import Crawler, prepare
from .crawler.step import Certificate, Step
from .derivative.sensitivities import Kink, Sensitivities, sensitivities
from .errors import CommandError, CrawlerError, SceneError
from .identify.excite import Excitation, excite
from .identify.identify import Identification, identify
from .identify.measurements import MeasurementError, Measurements
from .optimise.optimise import optimise
from .optimise.optimum import Optimum
from .optimise.pareto import Front, pareto
from .run.account import Energy
from .run.cycle import LimitCycle, limit_cycle
from .run.limits import Limit, largest_tow, steepest_climb
from .run.simulate import Trajectory, simulate
from .run.table import TrajectoryColumns
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
    "Front",
    "Identification",
    "Kink",
    "Limit",
    "LimitCycle",
    "ManyRuns",
    "MeasurementError",
    "Measurements",
    "Optimum",
    "Scene",
    "SceneError",
    "Sensitivities",
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
    "prepare",
    "sensitivities",
    "simulate",
    "simulate_many",
    "steepest_climb",
    "vary",
]
