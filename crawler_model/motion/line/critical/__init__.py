"""The translation of what nothing holds: critical states of the body, or of parts that flat springs separate."""
