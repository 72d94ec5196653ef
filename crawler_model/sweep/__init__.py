"""Many scenes at once: variations, runs, workers."""
