"""Bodies in the plane, to a tolerance."""
