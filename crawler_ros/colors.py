"""Colours of pictures, importable under this documented name; see `crawler_pictures.colors`."""

from crawler_pictures.colors import ACTUATION, BACK, CONTACTS, FORWARD, GREY, STICK, TENSION, rgb

__all__ = ["ACTUATION", "BACK", "CONTACTS", "FORWARD", "GREY", "STICK", "TENSION", "rgb"]
