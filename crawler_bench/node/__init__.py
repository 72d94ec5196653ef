"""What the node and replay cost, measured with real processes."""
