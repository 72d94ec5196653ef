"""Tolerances for rounding errors, one definition each; compiled kernels read them as constants."""

from __future__ import annotations

import numpy as np

EPS = float(np.finfo(np.float64).eps)
"""Spacing of floats at 1, relative to 1."""
CRITICAL = 1e-12
"""Below this relative margin a balance of friction forces counts as exact: 0.1 and 0.3 are not 1/10 and 3/10."""
NOISE = 1e-14
"""A velocity below this part of the largest velocity, or of the sum of the shape rates around it, is rounding."""
SHORTEST_STRETCH = 1e-6
"""A piece shorter than this part of its ramp is an isolated instant. All contacts count as at their bounds within a
tolerance, so such an instant seems to last as long as the slowest contact takes to cross that tolerance."""
LATE = 0.999
"""Place on a ramp beyond which an arrival may coincide with the ramp's end except for rounding."""
MISSED = 1e-6
"""A force beyond its bound by more than this part of the friction, or an energy that is off by more than this part of
the energies of a ramp, is no rounding: the ramp was not solved."""
