"""Uniqueness margins, importable under this documented name; see `crawler_model.theory.uniqueness`."""

from .motion.margin import visited_margin
from .theory.uniqueness import commanded_margin, translation_interval, uniqueness_margin

__all__ = ["commanded_margin", "translation_interval", "uniqueness_margin", "visited_margin"]
