"""Many scenes at once: variations, runs and workers."""
