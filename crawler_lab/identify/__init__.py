"""Identification: the numbers of a scene that repeat measured motion, and what a recording decides about each."""
