"""An example controller: a search for the phase between shape and friction that moves two contacts furthest.

The link lengthens and shortens once a period; the friction of one contact rises while the other's falls, delayed
by a phase. Each trial plays two periods, the first to settle, and measures the distance of the second. A coarse scan of
all phases finds the neighbourhood of the best one, and steps halved repeatedly refine it.
"""

from __future__ import annotations

from collections.abc import Generator

from crawler_ros.examples.periods import PeriodController, from_to, run, within


class PhaseControl(PeriodController):
    """Plays period after period, each with a phase that depends on the distances of earlier ones."""

    def __init__(self) -> None:
        """Declare parameters and open topics."""
        super().__init__("phase_control")
        self.joints = ["link_0", "contact_0/friction", "contact_1/friction"]
        self.length = self.declare_parameter("length", 4.0, within(-1e3, 1e3)).value  # of the stroke, m
        self.friction = self.declare_parameter("friction", 1.0, within(1e-9, 1e6)).value  # mean, N
        self.depth = self.declare_parameter("depth", 0.5, within(0.0, 1.0)).value  # modulated fraction of it
        self.phases = self.declare_parameter("phases", 8, from_to(1, 1000)).value  # of the coarse scan
        self.tolerance = self.declare_parameter("tolerance", 1e-4, within(1e-9, 1.0)).value  # of the phase, in periods
        self.begin()

    def choose(self) -> Generator[float, float, None]:
        """Yield the phase of each period; receive the distance travelled in it."""
        step, rounding = 1.0 / self.phases, 1e-9 * self.length
        best, most = 0.0, -float("inf")
        for phase in [k * step for k in range(self.phases)]:
            gained = yield from self.try_phase(phase)
            if gained > most + rounding:
                best, most = phase, gained
        while step > self.tolerance:
            step *= 0.5
            for phase in ((best + step) % 1.0, (best - step) % 1.0):
                gained = yield from self.try_phase(phase)
                if gained > most + rounding:
                    best, most = phase, gained
                    break
        self.get_logger().info(f"best phase {best!r} of a period, {most!r} m per period")

    def try_phase(self, phase: float) -> Generator[float, float, float]:
        """Play a phase for two periods; return the distance of the second."""
        yield phase
        gained = yield phase
        self.get_logger().info(f"phase {phase!r}: gained {gained!r} m")
        return gained

    def waypoints(self, choice: float) -> list[tuple[int, list[float]]]:
        """Lengthen and shorten the link, and swing friction between the contacts in a triangle, late by the phase."""
        rows = []
        for t in sorted({0.0, 0.5, 1.0, (0.25 + choice) % 1.0, (0.75 + choice) % 1.0}):  # where a wave turns
            # 0, depth, 0, -depth at the quarters of t - phase
            swing = self.depth * (1.0 - 4.0 * abs((t - choice + 0.25) % 1.0 - 0.5))
            length = self.length * (1.0 - abs(1.0 - 2.0 * t))
            friction = [self.friction * (1.0 + swing), self.friction * (1.0 - swing)]
            rows.append((round(t * self.period), [length, *friction]))
        return rows


def main(args: list[str] | None = None) -> None:
    """Run the controller until the phase is found, or until a signal.

    Args:
        args: command line; None for the process's own.
    """
    run("phase_control", PhaseControl, __doc__, args)


if __name__ == "__main__":
    main()
