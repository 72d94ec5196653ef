"""Identification: the numbers of a scene under which the model repeats measured motion, and what a recording decides."""
