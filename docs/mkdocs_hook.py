"""Additions of the site to docs/: the pages at the top of the repository, files that pages link to, typeset equations.

Pages are written to be read on a forge: their links are paths in the repository. In the site files in docs/ move one
folder up, and all other files keep their paths. The site has a home page of its own, docs/index.md, in place of
README.md. mkdocs calls it (`hooks` in mkdocs.yml).
"""

from __future__ import annotations

import html
import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, InclusionLevel

ROOT = Path(__file__).parent.parent
TOP = ("CONTRIBUTING.md", "CHANGELOG.md")
UNSEARCHED = ("CHANGELOG.md", "design.md")
"""Pages of history, which a search would find first although they do not answer it."""
LINK = re.compile(r"(?<=\]\()([^)\s#]+)(?=[)\s#])")
API = re.compile(r'\]\([^)\s]+ "(crawler_[\w.]+)"\)')
_ALONE = InclusionLevel.NOT_IN_NAV
EQUATIONS = re.compile(r"^(?P<indent> *)```equations\n(?P<text>(?:.*\n)*?) *```$", re.M)
_NAME = re.compile(
    r"(?P<word>\ba(?= [a-z]{3}))|(?P<code>[a-z]+(?:\.[a-z_]+|_margin)\b)|(?P<name>[A-Za-z]+)"
    r"(?P<below>(?:_(?:\{[^}]*\}|[A-Za-z]+))*)(?P<above>\^(?:\{[^}]*\}|\w|[−+]))?"
)
_SIGNS = {"mu": "μ", "xi": "ξ", "chi": "χ", "theta": "θ", "eps": "ε", "Deps": "Δε", "sum": "Σ", "dR": "∂R"}
_SIGNS |= {"plus": "+", "minus": "−"}
_UPRIGHT = ("min", "max", "argmin", "cos", "sin", "diag")
DOCSTRING = re.compile(r"<!-- docstring of ([\w.]+) -->")


def in_repository(site: str) -> str:
    """Return the path in the repository of a file of the site."""
    return f"docs/{site}" if (ROOT / "docs" / site).exists() else site


def in_site(file: str) -> str:
    """Return the path in the site of a file of the repository."""
    return file.removeprefix("docs/")


def target(link: str, page: str) -> str | None:
    """Resolve a link.

    Args:
        link: as written in the page, without an anchor.
        page: the page's path in the repository.

    Returns:
        The path of the file in the repository; None if the link is not a file of the repository.
    """
    path = posixpath.normpath(posixpath.join(posixpath.dirname(page), link))
    return path if (ROOT / path).is_file() and not path.startswith("..") else None


def on_files(files: Any, config: Any) -> Any:
    """Add the pages at the top and the files outside docs/ that pages link to; drop other programs in docs/."""
    for file in [file for file in files if file.src_uri.endswith(".py")]:
        files.remove(file)
    for file in TOP:
        files.append(File.generated(config, file, abs_src_path=str(ROOT / file)))
    todo = list(files.documentation_pages())
    while todo:
        page = todo.pop()
        for link in LINK.findall(page.content_string):
            file = target(link, in_repository(page.src_uri))
            if file is not None and files.get_file_from_path(in_site(file)) is None:
                added = File.generated(config, in_site(file), abs_src_path=str(ROOT / file), inclusion=_ALONE)
                files.append(added)
                todo += [added] if added.is_documentation_page() else []
    return files


def typeset(line: str) -> str:
    """Typeset a line of equations.

    Args:
        line: names with indices as `mu_plus_i` or `T_{i-1}`, powers as `v^+`, `<=`, ` in `, `sum`; words as they are.

    Returns:
        The line as HTML, with letters in italics, indices, powers and signs.
    """

    def letters(word: str) -> str:
        sign = _SIGNS.get(word, word)
        return f"<i>{sign}</i>" if len(sign) == 1 and sign.isalpha() and sign != "Σ" else sign

    def name(match: re.Match[str]) -> str:
        if match["name"] is None:
            return match["word"] or f"<code>{match[0]}</code>"
        below = [_plain(part.strip("{}")) for part in re.findall(r"\{[^}]*\}|[A-Za-z]+", match["below"])]
        above = _plain((match["above"] or "")[1:].strip("{}"))
        text = letters(match["name"]) if match["name"] not in _UPRIGHT else match["name"]
        text += f"<sub>{','.join(below)}</sub>" if below else ""
        return text + (f"<sup>{above}</sup>" if above else "")

    words = re.sub(r"(?<=[\d']) in (?!row)", " ∈ ", line.rstrip())
    for said, sign in (("<=", "≤"), (" . ", " · "), ("...", "…"), ("-", "−"), ("'", "′")):
        words = words.replace(said, sign)
    shown = _NAME.sub(name, html.escape(words, quote=False))
    return re.sub(r" {2,}", "&emsp;", re.sub(r"(?<=\))\^(\d)", r"<sup>\1</sup>", shown))


def _plain(index: str) -> str:
    return re.sub(r"[A-Za-z]+", lambda word: _SIGNS.get(word[0], word[0]), index.replace("-", "−"))


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Replace paths in the repository by paths in the site, comments by docstrings; keep history out of the search."""
    site = page.file.src_uri
    if site in UNSEARCHED:
        page.meta["search"] = {"exclude": True}
    here = in_repository(site)

    def moved(match: re.Match[str]) -> str:
        file = target(match[1], here)
        return match[1] if file is None else posixpath.relpath(in_site(file), posixpath.dirname(site) or ".")

    def set_lines(match: re.Match[str]) -> str:
        lines = (f"<div>{typeset(line)}</div>" for line in match["text"].splitlines() if line.strip())
        return f'{match["indent"]}<div class="equations">{"".join(lines)}</div>'

    markdown = EQUATIONS.sub(set_lines, markdown)
    return LINK.sub(moved, DOCSTRING.sub(r"::: \1", API.sub(r"][\1]", markdown)))
