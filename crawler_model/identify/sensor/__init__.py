"""What a measurement does to a motion: the sensor between positions and values, and its noise."""
