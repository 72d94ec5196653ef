"""Stasis domains, importable under this documented name; see `crawler_model.theory.stasis`."""

from .theory.stasis import (
    Facet,
    StasisDomain,
    directions_of,
    domain_evolution,
    is_in_stasis,
    section_forces,
    spring_force,
    stasis_bounds,
    stasis_margins,
    stasis_polygon,
    tension_ranges,
)

__all__ = [
    "Facet",
    "StasisDomain",
    "directions_of",
    "domain_evolution",
    "is_in_stasis",
    "section_forces",
    "spring_force",
    "stasis_bounds",
    "stasis_margins",
    "stasis_polygon",
    "tension_ranges",
]
