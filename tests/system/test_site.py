"""The site: it builds without a warning, loads nothing from elsewhere, and opens from a folder."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote

import pytest

pytest.importorskip("material", reason="the site is built with the extra docs")
pytest.importorskip("mkdocstrings_handlers.python", reason="the site is built with the extra docs")

from ..lab.play.pages import browsing
from ..pages import ROOT, pages
from ..processes import PATIENCE_S


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    quiet = {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=os.environ | quiet, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    return folder


def test_every_page_is_in_it_and_in_its_navigation(site):
    first = (site / "index.html").read_text(encoding="utf-8")
    navigation = first.split('aria-label="Navigation"')[1].split("md-sidebar--secondary")[0]
    for page in (page for page in pages() if page.parent == ROOT or ROOT / "docs" in page.parents):
        name = page.relative_to(ROOT).as_posix().removeprefix("docs/").removesuffix(".md")
        if name != "README":
            assert (site / f"{name}.html").is_file(), page
            assert f'href="{name}.html"' in navigation, page


def test_it_loads_nothing_from_elsewhere(site):
    """Links may lead out; scripts, styles, fonts and pictures come from the folder itself."""
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r"<(?:script|img|iframe|source)\b[^>]*\bsrc=\"?([^\s\">]+)", text)
        loaded += re.findall(r"<link\b[^>]*\bhref=\"?([^\s\">]+)", text)
        assert loaded
        for target in loaded:
            assert not re.match(r"(https?:)?//", target), f"{page}: {target}"
            if not target.startswith("data:") and page.name != "404.html":  # whose paths start at a server's root
                assert (page.parent / unquote(target.split("?")[0].split("#")[0])).exists(), f"{page}: {target}"
    for style in site.rglob("*.css"):
        assert not re.search(r"(url\(|@import\s+)[\"']?(https?:)?//", style.read_text(encoding="utf-8")), style


def test_links_of_the_forge_lead_somewhere_in_it_too(site):
    for page in site.rglob("*.html"):
        if page.name == "404.html":
            continue
        for target in re.findall(r"<a\b[^>]*\bhref=\"([^\"]+)\"", page.read_text(encoding="utf-8")):
            path = unquote(target.split("#")[0])
            if path and not re.match(r"[a-z]+:", path):
                assert (page.parent / path).exists(), f"{page}: {target}"


def test_the_python_page_has_the_docstrings(site):
    text = (site / "reference" / "python.html").read_text(encoding="utf-8")
    for name in ("crawler_model.crawler.crawler.Crawler.advance", "crawler_model.run.simulate.simulate"):
        assert f'id="{name}"' in text
    assert "<!-- docstring of" not in text
    assert re.search(r'href="#crawler_model\.scene\.scene\.Scene"', text)


def test_equations_are_typeset_without_a_program_from_elsewhere(site):
    for page, formula in (
        ("model", "<i>μ</i><sub>+,i</sub> <i>v</i><sub>i</sub><sup>+</sup>"),
        ("errata", "−<i>μ</i><sub>−</sub> ≤"),
    ):
        text = (site / f"{page}.html").read_text(encoding="utf-8")
        assert formula in text
        assert "language-equations" not in text


def test_history_is_not_found_by_a_search(site):
    index = (site / "search" / "search_index.json").read_text(encoding="utf-8")
    found = {place.split("#")[0] for place in re.findall(r'"location":\s*"([^"]+)"', index)}
    assert {"troubleshooting.html", "simulators.html", "scenes.html"} <= found
    assert not found & {"CHANGELOG.html", "design.html"}


def test_search_works_without_a_server(site):
    with browsing() as browser:
        page = browser.new_page()
        page.goto(f"file://{site}/lessons/strategies.html")
        page.click('input[data-md-component="search-query"]')
        page.keyboard.type("visited margin")
        page.wait_for_selector(".md-search-result__item", timeout=1000 * PATIENCE_S)
        assert "matching documents" in page.inner_text(".md-search-result__meta")
