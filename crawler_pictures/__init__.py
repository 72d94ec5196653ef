"""What is drawn on paper: bodies, stasis domains, sweeps."""
