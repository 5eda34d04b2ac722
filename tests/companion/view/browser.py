"""Pages in headless Chromium, where it is installed."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, expect, sync_playwright

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
FRAMES_APART_MS = 200
"""A page that is drawn in software would keep a core busy with sixty pictures a second."""
SELDOM = f"""
  const draw = requestAnimationFrame.bind(window);
  window.requestAnimationFrame = then => setTimeout(() => draw(then), {FRAMES_APART_MS});
  window.cancelAnimationFrame = number => clearTimeout(number);
"""
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
            expect.set_options(PATIENCE_MS)
            page.on("console", lambda said: errors.append(said.text) if said.type == "error" else None)
            page.on("pageerror", lambda error: errors.append(str(error)) if error.name != "EvalError" else None)
            page.add_init_script(SELDOM)
            page.goto(url)
            yield page, errors
        finally:
            browser.close()


def assert_legible(page: Page) -> None:
    """All text that is shown has the contrast of WCAG 2, level AA: 4.5 to 1, and 3 to 1 where it is large."""
    found = Axe().run(page, options={"runOnly": {"type": "rule", "values": ["color-contrast"]}}).response
    assert sum(len(rule["nodes"]) for rule in found["passes"]) > 10, "it was looked at"
    faint = [(node["html"], node["any"][0]["message"]) for rule in found["violations"] for node in rule["nodes"]]
    assert faint == []
