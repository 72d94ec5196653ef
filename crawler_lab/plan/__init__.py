"""The controller that plans: it follows a path of the net translation by optimised commands over a receding horizon."""
