"""The pictures of README and the site: ``python docs/pictures.py`` with Chromium and ``'.[dev]'``."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from browsing import FLAGS, ROOT, Server

from jointid.cli import app

DOCS = ROOT / "docs"
PAGES = {"study": ("/", 1000), "elasticity": ("/Elasticity", 1290), "cut": ("/Cut", 1000)}
"""Path and height of the picture, pixels."""
SETTLED_MS = 6000
"""Time for the last figures of a page, once its title is there."""


def main() -> None:
    """Write cut.svg and a picture of each page."""
    app(["cut", "paper", "--svg", str(DOCS / "cut.svg"), "--overwrite"], standalone_mode=False)
    with tempfile.TemporaryDirectory() as data, sync_playwright() as playwright:
        server = Server(ROOT, Path(data))
        try:
            browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=FLAGS)
            for name, (path, height) in PAGES.items():
                page = browser.new_page(viewport={"width": 1440, "height": height})
                page.goto(server.address + path)
                page.locator("h1").first.wait_for(timeout=60_000)
                page.wait_for_timeout(SETTLED_MS)
                page.wait_for_function("!document.querySelector('[data-testid=stSkeleton]')")
                page.screenshot(path=DOCS / f"{name}.png")
        finally:
            server.kill()


if __name__ == "__main__":
    main()
