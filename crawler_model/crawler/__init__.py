"""The crawler: its state at one instant, its response to a command, and its sensor readings."""
