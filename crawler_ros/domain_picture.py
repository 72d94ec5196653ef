"""Pictures of stasis domains, importable under this documented name; see `crawler_pictures.domain`."""

from crawler_pictures.domain import draw_domain

__all__ = ["draw_domain"]
