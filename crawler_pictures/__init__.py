"""Pictures of bodies, stasis domains and sweeps, drawn by matplotlib."""
