"""The simulated model as arrays: the body, the layout of its commands, and its drive."""
