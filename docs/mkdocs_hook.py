"""Additions of the site to docs/: the pages at the top of the repository, and every file that a page links to.

Pages are written to be read on a forge: their links are paths in the repository. In the site README.md is the first
page, files in docs/ move one folder up, and all other files keep their paths. mkdocs calls it (`hooks` in mkdocs.yml).
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, InclusionLevel

ROOT = Path(__file__).parent.parent
TOP = {"README.md": "index.md", "CONTRIBUTING.md": "CONTRIBUTING.md", "CHANGELOG.md": "CHANGELOG.md"}
LINK = re.compile(r"(?<=\]\()([^)\s#]+)(?=[)\s#])")
API = re.compile(r'\]\([^)\s]+ "(crawler_[\w.]+)"\)')
_ALONE = InclusionLevel.NOT_IN_NAV
DOCSTRING = re.compile(r"<!-- docstring of ([\w.]+) -->")


def in_repository(site: str) -> str:
    """Return the path in the repository of a file of the site."""
    back = {place: file for file, place in TOP.items()}
    return back.get(site) or (f"docs/{site}" if (ROOT / "docs" / site).exists() else site)


def in_site(file: str) -> str:
    """Return the path in the site of a file of the repository."""
    return TOP.get(file, file.removeprefix("docs/"))


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
    for file, place in TOP.items():
        files.append(File.generated(config, place, abs_src_path=str(ROOT / file)))
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


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Replace paths in the repository by paths in the site, and the comments by docstrings."""
    site = page.file.src_uri
    here = in_repository(site)

    def moved(match: re.Match[str]) -> str:
        file = target(match[1], here)
        return match[1] if file is None else posixpath.relpath(in_site(file), posixpath.dirname(site) or ".")

    return LINK.sub(moved, DOCSTRING.sub(r"::: \1", API.sub(r"][\1]", markdown)))
