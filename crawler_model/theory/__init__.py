"""Theory of a body and its drive: stasis domains, uniqueness, regularity."""
