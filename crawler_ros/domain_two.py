"""Stasis domains of two contacts, importable under this documented name; see `crawler_pictures.domain_two`."""

from crawler_pictures.domain_two import draw_band, draw_box, draw_motion, draw_sweeping, draw_two

__all__ = ["draw_band", "draw_box", "draw_motion", "draw_sweeping", "draw_two"]
