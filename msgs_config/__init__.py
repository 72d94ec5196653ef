"""Data: topics, node parameters and the gallery of scenes."""
