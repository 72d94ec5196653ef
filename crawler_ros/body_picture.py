"""Pictures of bodies, importable under this documented name; see `crawler_pictures.body`."""

from crawler_pictures.body import draw_body, draw_length

__all__ = ["draw_body", "draw_length"]
