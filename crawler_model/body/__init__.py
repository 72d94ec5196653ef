"""What is simulated, as arrays: the body, what can be commanded of it, and what drives it."""
