"""Springs that are not linear: their pieces, and the events at their knots."""
