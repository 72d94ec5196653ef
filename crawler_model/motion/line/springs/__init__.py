"""Springs that are not linear: their pieces, the events at their knots, the parts of a body that flat ones separate."""
