"""Bodies on a line: one event-driven engine for chains and graphs, on any ground."""
