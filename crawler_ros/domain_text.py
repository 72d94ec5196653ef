"""Labels of stasis domains, importable under this documented name; see `crawler_pictures.domain_text`."""

from crawler_pictures.domain_text import STYLE, friction_at, label_of, verdict

__all__ = ["STYLE", "friction_at", "label_of", "verdict"]
