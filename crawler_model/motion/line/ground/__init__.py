"""Patches of ground: borders, and the falls of contacts that come to ground that holds less."""
