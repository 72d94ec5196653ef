"""How commands come in: received, checked, bounded, queued, or refused."""
