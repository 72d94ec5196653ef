"""The crawler at one instant, what it answers to a command, and what its sensors read."""
