"""The cost of the node and of replay, measured with real processes."""
