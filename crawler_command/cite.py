"""`crawler cite`: what a paper cites, in BibTeX."""

from __future__ import annotations

from crawler_model import __version__

ENTRIES = f"""\
@software{{crawler,
  title   = {{crawler: a simulator of rate-independent soft crawlers, exact on a line}},
  author  = {{{{The crawler maintainers}}}},
  version = {{{__version__}}},
  year    = {{2026}},
}}

@article{{gidoni2018,
  title   = {{Rate-independent soft crawlers}},
  author  = {{Gidoni, Paolo}},
  journal = {{The Quarterly Journal of Mechanics and Applied Mathematics}},
  year    = {{2018}},
  volume  = {{71}},
  number  = {{4}},
  pages   = {{369--409}},
  eprint  = {{1710.08340}},
  archiveprefix = {{arXiv}},
}}"""
"""The program, and the paper whose model it integrates; CITATION.cff says the same."""


def cite() -> None:
    """Print BibTeX entries of this version of the program and of the paper whose model it integrates."""
    print(ENTRIES)
