"""The results of a comparison of methods."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .ratios import compute_ratios


@dataclass(eq=False)
class BenchResult:
    """The rows measured, and what is needed to interpret them.

    Attributes:
        machine: description of the machine.
        references: certificate of each case's reference.
        rows: a row for each method, number of ticks and case.
        left_out: case, method and reason for each method that cannot be compared.
    """

    machine: dict[str, Any]
    references: dict[str, dict[str, Any]] = field(default_factory=dict)
    titles: dict[str, str] = field(default_factory=dict)
    rows: list[dict[str, Any]] = field(default_factory=list)
    left_out: list[dict[str, str]] = field(default_factory=list)

    def document(self) -> dict[str, Any]:
        """Convert to plain data, without NaN or Infinity.

        Returns:
            Machine, references, ratios, left_out and rows.
        """
        return {
            "machine": self.machine,
            "references": self.references,
            "ratios": compute_ratios(self.rows),
            "left_out": self.left_out,
            "rows": self.rows,
        }
