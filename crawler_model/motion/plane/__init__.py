"""Bodies in the plane, solved to a tolerance."""
