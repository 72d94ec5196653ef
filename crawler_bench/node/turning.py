"""Whether a body that turns keeps real time: late ticks, processor time of a tick, and the largest speed."""

from __future__ import annotations

from .domain import Domain
from .drives import swim, write_snake
from .processes import wait_until
from .rows import Row, summarise
from .steps import Steps

_RATE_HZ = 100.0


def measure_turning(domain: Domain, contacts: int, seconds: float, repeats: int, steps: Steps) -> list[Row]:
    """Measure a driven snake at 100 Hz, in real time and then as fast as it goes.

    Args:
        domain: domain of the processes.
        contacts: number of contacts N.
        seconds: duration of a measurement [s].
        repeats: number of repetitions.
        steps: the progress.

    Returns:
        One row: ticks and late ticks in real time, the processor time of a tick and of all ticks of a second, and the
        largest speed relative to real time.
    """
    found: dict[str, list[float]] = {}
    with steps.keep():
        for _ in range(repeats):
            steps(f"a body that turns, N={contacts}")
            scene = write_snake(domain.folder, contacts)
            values: dict[str, float] = {}
            with domain.simulator(scene, rate=_RATE_HZ, real_time_factor=1.0) as (pid, _log):
                _start_swimming(domain, contacts)
                before = int(domain.reports[-1][1]["late ticks"])
                _, (used,) = domain.cost(seconds, [pid], driven=True)
                values["late_ticks"] = int(domain.reports[-1][1]["late ticks"]) - before
            values |= {"cpu_us_per_tick": used, "core_simulator": 1e-6 * used * _RATE_HZ}
            with domain.simulator(scene, rate=_RATE_HZ, real_time_factor=0.0):
                _start_swimming(domain, contacts)
                values["real_time"] = domain.rate(seconds, driven=True) / _RATE_HZ
            for name, value in values.items():
                found.setdefault(name, []).append(value)
    row: Row = {"case": "turning", "n": contacts, "rate_hz": _RATE_HZ, "ticks": int(seconds * _RATE_HZ)}
    for name, measured in found.items():
        row |= summarise(measured, name)
    return [row] if found else []


def _start_swimming(domain: Domain, contacts: int) -> None:
    """Drive the snake, and wait for two periods: the first ticks load kernels."""
    swim(domain, contacts)
    wait_until(lambda: not domain.reports[-1][1]["rows waiting"].startswith("0 "))
    first = int(domain.reports[-1][1]["ticks"])
    wait_until(lambda: int(domain.reports[-1][1]["ticks"]) > first + 2 * _RATE_HZ)
