"""What the laboratory draws with matplotlib: sweeps, gaits, fits and predictions."""
