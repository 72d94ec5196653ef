"""What holds before anything moves: stasis domains, uniqueness, regularity."""
