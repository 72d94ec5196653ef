"""The intake of commands: they are received, checked, bounded and queued, or refused."""
