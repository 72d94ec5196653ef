"""The wire format: topics and types, bytes, names."""
