"""Domains of three contacts and more, importable under this documented name; see `crawler_pictures.domain_many`."""

from crawler_pictures.domain_many import draw_box_in_space, draw_many, draw_path, draw_polygon, draw_three

__all__ = ["draw_box_in_space", "draw_many", "draw_path", "draw_polygon", "draw_three"]
