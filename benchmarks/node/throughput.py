"""The largest number of ticks per second: held and driven, recorded or not, with and without a subscriber."""

from __future__ import annotations

import contextlib
import itertools
import statistics
import time
from collections.abc import Sequence

from tests.processes import children
from tests.scenes import write_chain

from .domain import TICK_HZ, Domain
from .drives import wave
from .rows import Row, summarise
from .steps import Steps

Variant = tuple[int, bool, bool, bool, int]
_EVERY = 10
"""The ticks between states in the rows with fewer states."""


def throughput_variants(contacts: Sequence[int], quick: bool) -> list[Variant]:
    """List what the throughput is measured for.

    Returns:
        Contacts, recorded, with a subscriber to all topics, driven, and the ticks from one state to the next.
    """
    both = (False, True)
    variants = [(n, record, heard, True, 1) for n, record, heard in itertools.product(contacts, both, both)]
    variants += [(n, True, False, True, _EVERY) for n in contacts]
    held = [(n, True, subscribed, False, 1) for n in contacts for subscribed in both]
    return variants if quick else variants + held


def measure_throughput(
    domain: Domain, variants: Sequence[Variant], seconds: float, repeats: int, steps: Steps
) -> list[Row]:
    """Measure the largest number of ticks per second, and the processor time of a tick.

    Returns:
        The rows.
    """
    found: dict[Variant, list[tuple[float, list[float]]]] = {variant: [] for variant in variants}
    with steps.keep():
        for _, variant in itertools.product(range(repeats), variants):
            n, record, subscribed, driven, every = variant
            what = " recorded" * record + " subscribed" * subscribed + " driven" * driven
            steps(f"throughput N={n}{what}, states at every {every}. tick")
            with contextlib.ExitStack() as stack:
                if subscribed:
                    stack.enter_context(domain.process("benchmarks.node.companions", "listen"))
                pid, _log = stack.enter_context(
                    domain.simulator(write_chain(domain.folder, n), record=record, **{"publish.every": every})
                )
                if driven:
                    wave(domain, n)
                if subscribed:
                    time.sleep(1.5)  # until it has discovered all topics
                found[variant].append(domain.cost(seconds, [pid, *children(pid)], driven))
    rows = []
    for (n, record, subscribed, driven, every), costs in found.items():
        if not costs:
            continue
        rates = [rate for rate, _ in costs]
        row: Row = {"case": "throughput", "n": n, "recording": record, "subscriber": subscribed, "driven": driven}
        row["every"] = every
        row |= summarise(rates, "ticks_per_s") | summarise([1e6 / r for r in rates], "us_per_tick")
        for k, name in enumerate(("simulator", "recorder")):
            row[f"cpu_{name}_us"] = statistics.median(used[k] for _, used in costs) if k <= record else None
        rows.append(row | {"real_time": row["ticks_per_s"] / TICK_HZ})
    return rows
