"""What goes over the wire: topics and types, bytes, names."""
