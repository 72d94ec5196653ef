"""A server in a thread, and pages in a real browser without a window."""

from __future__ import annotations

import asyncio
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def wait_until(holds: Callable[[], Any], what: str, seconds: float = 120.0) -> Any:
    """Wait for an event, as long as a busy machine needs."""
    end = time.monotonic() + seconds
    while not (found := holds()):
        assert time.monotonic() < end, f"waited for {what}"
        time.sleep(0.01)
    return found


@contextmanager
def served(robot: Any) -> Iterator[Any]:
    """Serve a robot; all that touches it runs in the loop of the server, through `server.ask`."""
    from crawler_lab.play.server import Server

    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()

    def run(work: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(work, loop).result(120)

    async def call(work: Callable[[], Any]) -> Any:
        return work()

    server: Any = Server(robot)
    server.ask = lambda work: run(call(work))
    runner = run(server.start())
    try:
        yield server
    finally:
        run(runner.cleanup())
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


async def next_frame(page: Any, holds: Callable[[dict[str, Any]], Any] = lambda _: True) -> dict[str, Any]:
    """Answer frames until one fits."""
    while True:
        message = await page.receive_json()
        if "frame" in message:
            await page.send_json({"seen": message["frame"]})
            if holds(message):
                return message


async def complaint(page: Any) -> str:
    """Answer frames until an error is reported."""
    while "error" not in (message := await page.receive_json()) or "frame" in message:
        if "frame" in message:
            await page.send_json({"seen": message["frame"]})
    return message["error"]


@contextmanager
def browsing() -> Iterator[Any]:
    """A real Chromium; skipped by name where there is none."""
    playwright = pytest.importorskip("playwright.sync_api")
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip(f"no browser: none of {', '.join(BROWSERS)} is installed")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=found, args=["--no-sandbox"])
        try:
            yield browser
        finally:
            browser.close()


def open_page(browser: Any, address: str, **options: Any) -> Any:
    """Open a page, which does not play by itself, and wait until it has drawn; an error of its script fails the test."""
    options = {"viewport": {"width": 1400, "height": 1000}, "reduced_motion": "reduce", **options}
    context = browser.new_context(accept_downloads=True, **options)
    page = context.new_page()
    page.problems = []
    page.on("pageerror", lambda error: page.problems.append(str(error)))
    page.goto(address)
    wait_until(lambda: page.evaluate("window.drawn > 1"), "the first picture")
    return page
