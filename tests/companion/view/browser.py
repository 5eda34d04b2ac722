"""Pages in headless Chromium, where it is installed."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from playwright.sync_api import Page, sync_playwright

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
PATIENCE_MS = 60_000
"""A browser that draws in software beside other work is slow; nothing here is about how fast it is."""


@contextmanager
def opened(url: str, *, fine: float = 1.0) -> Iterator[tuple[Page, list[str]]]:
    """The page at a URL, drawn with `fine` pixels to one of its own, and the errors that it has had so far.

    An EvalError is none: viser's sorter of Gaussian splats would evaluate strings, and the live page has no splats.
    """
    errors: list[str] = []
    with sync_playwright() as playwright:
        arguments = ["--enable-unsafe-swiftshader", "--disable-dev-shm-usage"]
        arguments += ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        try:
            page = browser.new_page(viewport={"width": 1000, "height": 640}, device_scale_factor=fine)
            page.set_default_timeout(PATIENCE_MS)
            page.on("console", lambda said: errors.append(said.text) if said.type == "error" else None)
            page.on("pageerror", lambda error: errors.append(str(error)) if error.name != "EvalError" else None)
            page.goto(url)
            yield page, errors
        finally:
            browser.close()
