"""The app in Chromium with one user: start, first figure, pages, settings, response to a slider.

A rerun lasts from the person's key or click to the moment when the page says that its script has ended,
by the browser's own clock. ``sessions`` measures many users at once, without browsers.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser, Page, sync_playwright

from benchmarks.harness import Table

ROOT = Path(__file__).parents[1]
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]
FLAGS += ["--no-first-run", "--disable-background-timer-throttling", "--disable-renderer-backgrounding"]
PATIENCE_MS = 120_000
PAGES = (
    "Records",
    "Phasors",
    "Transfer matrix",
    "Elasticity",
    "Cut",
    "Plan",
    "Report and export",
    "Study",
)
COLUMNS = {"what": "", "median": "ms", "longest": "ms", "count": ".0f"}

# Milliseconds of every rerun, from the last act until the script's end is known and drawn. A short run
# comes and goes between two frames, so that its end is read from the server's message (script_finished,
# field 6 of streamlit's ForwardMsg); then the page itself must say that nothing runs.
WATCH = """
(() => {
  window.reruns = []; let acted = null;
  for (const kind of ['pointerdown', 'keydown', 'input'])
    addEventListener(kind, () => { acted = window.actedAt = performance.now(); }, {capture: true});
  const running = () => document.querySelector('[data-testid=stApp]')
    ?.getAttribute('data-test-script-state') !== 'notRunning';
  const note = () => {
    if (acted === null) return;
    if (running()) { requestAnimationFrame(note); return; }
    window.reruns.push(performance.now() - acted); acted = null;
  };
  const ends = bytes => {
    let at = 0;
    const varint = () => {
      let value = 0, scale = 1, byte;
      do { byte = bytes[at++]; value += (byte & 127) * scale; scale *= 128; } while (byte & 128);
      return value;
    };
    while (at < bytes.length) {
      const tag = varint(), wire = tag % 8;
      if (tag === 48) return true;
      if (wire === 0) varint(); else if (wire === 2) { const n = varint(); at += n; }
      else at += wire === 1 ? 8 : 4;
    }
    return false;
  };
  const Socket = window.WebSocket;
  window.WebSocket = class extends Socket {
    constructor(...given) {
      super(...given);
      this.addEventListener('message', async event => {
        const data = event.data instanceof Blob ? await event.data.arrayBuffer() : event.data;
        if (ends(new Uint8Array(data))) requestAnimationFrame(() => requestAnimationFrame(note));
      });
    }
  };
})()
"""
# The animation sets its label whenever it gets other paths, and draws them in the next frame.
NOTE_DRAWING = """
canvas => {
  window.drawn = null;
  const look = new MutationObserver(() => {
    look.disconnect();
    requestAnimationFrame(() => requestAnimationFrame(() => { window.drawn = performance.now(); }));
  });
  look.observe(canvas, {attributes: true, attributeFilter: ['aria-label']});
}
"""
RESTED = """() => document.querySelector('[data-testid=stApp]')
  ?.getAttribute('data-test-script-state') === 'notRunning'"""
DRAWN = """() => document.querySelectorAll('[data-testid=stMetric]').length >= 2
  && document.querySelector('.js-plotly-plot .main-svg .scatterlayer .trace') !== null"""


def measure(quick: bool) -> Iterator[Table]:
    """Four tables, each as soon as it is measured."""
    sys.path.insert(0, str(ROOT / "tests"))
    from browsing import Server

    chromium = next(
        filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
    )
    if chromium is None:
        raise RuntimeError("There is no chromium on the PATH.")
    repeat = 1 if quick else 4
    found: dict[str, list[float]] = {}
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as store:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        for turn in range(repeat):
            begin = time.perf_counter()
            server = Server(ROOT, Path(store))
            try:
                found.setdefault("server start", []).append(time.perf_counter() - begin)
                found.setdefault("first figure, cold server", []).append(_first_picture(browser, server))
                if turn == repeat - 1:
                    again = [_first_picture(browser, server) for _ in range(repeat)]
                    found["first figure, another session"] = again
                    yield _table("Server start and first figure", found)
                    page = _visit(browser, server)
                    yield _table("Another page", _pages(page, repeat))
                    yield _table("Another setting", _settings(page, repeat))
                    yield _table("Corner zone of the cut, by the slider", _slider(page, repeat))
            finally:
                server.kill()
        browser.close()


def _first_picture(browser: Browser, server: object) -> float:
    """From the address to tiles and a drawn figure, with an empty browser cache."""
    context = browser.new_context(viewport={"width": 1440, "height": 900})
    page = context.new_page()
    begin = time.perf_counter()
    page.goto(server.address, wait_until="commit")  # type: ignore[attr-defined]
    page.wait_for_function(DRAWN, timeout=PATIENCE_MS)
    passed = time.perf_counter() - begin
    context.close()
    return passed


def _visit(browser: Browser, server: object) -> Page:
    page = browser.new_page(viewport={"width": 1440, "height": 900})
    page.set_default_timeout(PATIENCE_MS)
    page.add_init_script(WATCH)
    page.goto(server.address, wait_until="commit")  # type: ignore[attr-defined]
    page.wait_for_function(DRAWN, timeout=PATIENCE_MS)
    _rest(page)
    return page


def _pages(page: Page, repeat: int) -> dict[str, list[float]]:
    found: dict[str, list[float]] = {}
    for turn in range(repeat + 1):
        for name in PAGES:
            key = f"{name}, first time" if turn == 0 else name
            found.setdefault(key, []).append(_timed(page, lambda name=name: _go(page, name)))
    return found


def _settings(page: Page, repeat: int) -> dict[str, list[float]]:
    """Down in a select box: another record, another estimator."""
    found = {}
    for what, on, box, most in (
        ("another record", "Records", "Record", repeat),
        ("another record's arrows", "Phasors", "Record", repeat),
        ("another estimator", "Elasticity", "Estimator", 2),  # the last one is then chosen
    ):
        _timed(page, lambda on=on: _go(page, on))
        found[what] = [_timed(page, lambda box=box: _next(page, box)) for _ in range(min(repeat, most))]
    return found


def _slider(page: Page, repeat: int) -> dict[str, list[float]]:
    """From the key to the picture that shows it, and to the end of the rerun."""
    _timed(page, lambda: _go(page, "Cut"))
    slider, picture = page.get_by_role("slider", name="Corner zone"), page.locator("canvas.cut")
    found: dict[str, list[float]] = {}
    for when, arrow in (("first time", "ArrowLeft"), ("seen before", "ArrowRight")):
        for _ in range(repeat):
            picture.evaluate(NOTE_DRAWING)
            took = _timed(page, lambda arrow=arrow: slider.press(arrow), settle=False)
            page.wait_for_function("() => window.drawn !== null")
            drawn = float(page.evaluate("() => window.drawn - window.actedAt")) / 1e3
            found.setdefault(f"picture, {when}", []).append(drawn)
            found.setdefault(f"end of the rerun, {when}", []).append(took)
            _rest(page)
    return found


def _go(page: Page, name: str) -> None:
    page.get_by_test_id("stSidebar").get_by_role("link", name=name, exact=True).click()


def _next(page: Page, box: str) -> None:
    page.get_by_role("combobox", name=box).first.focus()
    for key in ("ArrowDown", "ArrowDown", "Enter"):
        page.keyboard.press(key)


def _timed(page: Page, act: Callable[[], None], *, settle: bool = True) -> float:
    """Act and return the seconds until the script has ended."""
    seen = page.evaluate("() => window.reruns.length")
    act()
    page.wait_for_function("n => window.reruns.length > n", arg=seen)
    passed = float(page.evaluate("n => window.reruns[n]", seen)) / 1e3
    if settle:
        _rest(page)
    return passed


def _rest(page: Page) -> None:
    for pause in (300, 0):
        page.wait_for_function(RESTED)
        page.wait_for_timeout(pause)


def _table(title: str, found: Mapping[str, Sequence[float]]) -> Table:
    rows = (
        {"what": what, "median": float(np.median(s)), "longest": max(s), "count": float(len(s))}
        for what, s in found.items()
    )
    return Table("app", title, COLUMNS, tuple(rows))
