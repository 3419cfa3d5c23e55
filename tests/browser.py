"""A browser without a window, for tests of pages: Debian's Chromium through Playwright, drawing in software."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from peers import need

#: It needs no network: what would ask for one at the start is turned off.
FLAGS = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)


@contextmanager
def browser() -> Iterator[Any]:
    """A Playwright browser; the test skips where there is none."""
    playwright = need("playwright.sync_api")
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("needs chromium (the Debian package) to look at pages")
    with playwright.sync_playwright() as runner:
        running = runner.chromium.launch(executable_path=chromium, args=list(FLAGS))
        try:
            yield running
        finally:
            running.close()


@contextmanager
def page_of(running: Any, url: str, width: int = 900, height: int = 640) -> Iterator[Any]:
    """A page that is open, and has said nothing bad when it is left."""
    page = running.new_page(viewport={"width": width, "height": height})
    complaints: list[str] = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
    page.goto(url)
    try:
        yield page
        assert complaints == []
    finally:
        page.close()
