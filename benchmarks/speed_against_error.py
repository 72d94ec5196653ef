"""Time per tick against error, our two methods and warm-started OSQP, interleaved in one run; ratios count."""

from __future__ import annotations

import json
import platform
import statistics
import time
from pathlib import Path

import numpy as np
import osqp
import scipy.sparse as sp

from crawler_model import Crawler, Scene

ROUNDS = 5
TICKS = 100


def wave_scene(contacts: int) -> Scene:
    """A wave of lengthening, twenty links long, on contacts that slide forwards more easily."""
    length = min(contacts / 2 + 0.3, 20.0)
    middle = np.arange(contacts - 1) + 0.5
    start = np.concatenate(([0.0], np.cumsum(np.sin(-2 * np.pi * middle / length))))
    return Scene.model_validate(
        {
            "name": f"wave of {contacts}",
            "body": {"contacts": list(range(contacts)), "links": {"stiffness": 1.0}},
            "friction": {"forward": 0.1, "backward": 0.3},
            "start": {"displacement": start.tolist()},
            "drive": {"wave": {"amplitude": 1.0, "wavelength": length, "period": 1.0}},
        }
    )


class Osqp:
    """The same catch-up steps by OSQP: matrices set up once, warm-started, bounds constant."""

    def __init__(self, scene: Scene, tolerance: float) -> None:
        n, drive = scene.mesh.springs, scene.commands
        difference = sp.diags([np.ones(n), -np.ones(n)], [0, -1], shape=(n + 1, n)).tocsc()
        self.k, self.actuation, self.tension = scene.mesh.stiffness, drive.actuation[0], np.zeros(n)
        self.solver = osqp.OSQP()
        self.solver.setup(
            *(sp.diags(1 / self.k).tocsc(), np.zeros(n), difference, -drive.backward[0], drive.forward[0]),
            **{"verbose": False, "eps_abs": tolerance, "eps_rel": tolerance, "max_iter": 100_000},
        )

    def tick(self, actuation: np.ndarray) -> None:
        trial = self.tension - self.k * (actuation - self.actuation)
        self.solver.update(q=-trial / self.k)
        self.tension, self.actuation = self.solver.solve().x, actuation


def measure(contacts: int) -> list[dict[str, object]]:
    scene = wave_scene(contacts)
    targets = np.ascontiguousarray(scene.commands.sample(np.arange(1, TICKS + 1) * 10_000_000))
    reference = Crawler(scene, "catch_up")
    reference.follow(targets)
    times: dict[str, list[float]] = {"exact": [], "catch_up": []}
    tolerances = (1e-3, 1e-9) if contacts <= 1000 else ()
    times |= {f"osqp {t:g}": [] for t in tolerances}
    error: dict[str, float] = {}
    for _ in range(ROUNDS):
        for method in ("exact", "catch_up"):
            crawler = Crawler(scene, method)
            began = time.perf_counter()
            crawler.follow(targets)
            times[method].append((time.perf_counter() - began) / TICKS * 1e6)
            error[method] = float(np.abs(crawler.tension - reference.tension).max()) if method == "catch_up" else 0.0
        for tolerance in tolerances:
            peer = Osqp(scene, tolerance)
            began = time.perf_counter()
            for row in targets[:, : scene.mesh.springs]:
                peer.tick(row)
            times[f"osqp {tolerance:g}"].append((time.perf_counter() - began) / TICKS * 1e6)
            error[f"osqp {tolerance:g}"] = float(np.abs(peer.tension - reference.tension).max())
    ours = statistics.median(times["catch_up"])
    return [
        {
            "case": scene.name,
            "n": contacts,
            "method": method,
            "us_per_tick": statistics.median(values),
            "times_catch_up": statistics.median(values) / ours,
            "tension_error": error[method],
        }
        for method, values in times.items()
    ]


def main() -> None:
    Crawler(wave_scene(10)).advance(np.ones(9))
    rows = []
    print(f"{'case':<16}{'method':<12}{'us a tick':>12}{'x catch_up':>12}{'tension error':>16}")
    for contacts in (2, 10, 100, 1_000, 10_000, 100_000):
        for row in measure(contacts):
            rows.append(row)
            print(
                f"{row['case']:<16}{row['method']:<12}{row['us_per_tick']:>12.2f}{row['times_catch_up']:>12.2f}"
                f"{row['tension_error']:>16.1e}"
            )
    out = Path(__file__).parent / "results" / "speed_against_error.json"
    out.parent.mkdir(exist_ok=True)
    machine = {"machine": platform.machine(), "python": platform.python_version()}
    out.write_text(json.dumps({"machine": machine, "rows": rows}, indent=1) + "\n", encoding="utf-8")
    print(f"written: {out.relative_to(Path.cwd()) if out.is_relative_to(Path.cwd()) else out}")


if __name__ == "__main__":
    main()
