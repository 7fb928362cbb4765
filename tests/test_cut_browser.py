"""The animated cut in a real browser: it advances, pauses, scrubs, and shows what the settings say."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import BrowserContext, Page, expect, sync_playwright

pytestmark = pytest.mark.browser

ROOT = Path(__file__).parents[1]
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--no-first-run",
]
PATIENCE_MS = 30_000
PROBE = re.compile(r"http://127\.0\.0\.1:\d+/\w+/_stcore/(health|host-config)")
WHOLE_PAGE = {"width": 1280, "height": 900}
PHONE = {"width": 390, "height": 844}

Look = Callable[[Page], None]
Browse = Callable[..., None]


@pytest.fixture(scope="module")
def address(sample_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A server of the app as it stands, with the tests' sample studies beside it."""
    tree = tmp_path_factory.mktemp("app")
    for name in ("app.py", "pages", "jointid", ".streamlit"):
        (tree / name).symlink_to(ROOT / name)
    (tree / "sample_data").symlink_to(sample_folder)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "streamlit", "run", "app.py", "--server.port", str(port)]
    command += ["--server.fileWatcherType", "none"]
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    server = subprocess.Popen(command, cwd=tree, **silent)
    try:
        for _ in range(300):
            try:
                with urllib.request.urlopen(f"http://127.0.0.1:{port}/_stcore/health", timeout=5):
                    break
            except (urllib.error.URLError, ConnectionError):
                time.sleep(0.1)
        else:
            raise AssertionError("The server did not come up.")
        yield f"http://127.0.0.1:{port}"
    finally:
        server.terminate()
        server.wait(timeout=20)


@pytest.fixture(scope="module")
def browse(address: str, chromium: str) -> Iterator[Browse]:
    """Look at a page; nothing may go wrong in it, and no request may leave the machine.

    Playwright runs once per thread, and other tests hold it in theirs: so this one has its own.
    """
    with ThreadPoolExecutor(1) as aside:
        playwright = aside.submit(lambda: sync_playwright().start()).result()
        browser = aside.submit(
            lambda: playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        ).result()
        contexts: dict[str, BrowserContext] = {}

        def kept(**options: Any) -> BrowserContext:
            """Windows of one kind share what the browser has already read."""
            kind = repr(options)
            if kind not in contexts:
                contexts[kind] = browser.new_context(**({"viewport": WHOLE_PAGE} | options))
            return contexts[kind]

        def look_at(look: Look, **options: Any) -> None:
            aside.submit(lambda: _look(kept(**options), f"{address}/Cut", look)).result()

        yield look_at
        aside.submit(browser.close).result()
        aside.submit(playwright.stop).result()


def _look(context: BrowserContext, url: str, look: Look) -> None:
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    errors: list[str] = []
    abroad: list[str] = []

    def console(message: Any) -> None:
        if message.type == "error" and not PROBE.fullmatch(str(message.location.get("url", ""))):
            errors.append(message.text)

    def request(request: Any) -> None:
        parts = urlsplit(request.url)
        if parts.scheme not in ("data", "blob") and parts.hostname != "127.0.0.1":
            abroad.append(request.url)

    page.on("console", console)
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("request", request)
    try:
        page.goto(url, wait_until="commit")
        expect(canvas(page)).to_have_attribute("data-frame", re.compile(r"\d+"), timeout=PATIENCE_MS)
        finished(page)
        look(page)
    finally:
        page.close()
    assert errors == []
    assert abroad == []


def canvas(page: Page) -> Any:
    return page.locator("canvas.cut")


def finished(page: Page) -> None:
    expect(page.get_by_test_id("stApp")).to_have_attribute(
        "data-test-script-state", "notRunning", timeout=PATIENCE_MS
    )
    expect(page.get_by_test_id("stException")).to_have_count(0)


def state(page: Page) -> dict[str, str]:
    """What the animation says of itself."""
    return dict(canvas(page).evaluate("canvas => ({...canvas.dataset})"))


def frame(page: Page) -> int:
    return int(state(page)["frame"])


def point(page: Page, name: str) -> tuple[float, float]:
    """Where a tool is drawn, mm."""
    x, y = map(float, state(page)[name].split(","))
    return x, y


def pixels(page: Page, which: str = "cut") -> str:
    return str(page.locator(f"canvas.{which}").evaluate("canvas => canvas.toDataURL()"))


def scrub(page: Page, time_s: float) -> None:
    page.get_by_role("slider", name="Time").evaluate(
        "(slider, value) => { slider.value = value; slider.dispatchEvent(new Event('input')); }", time_s
    )


def in_view(page: Page) -> None:
    canvas(page).scroll_into_view_if_needed()


def test_it_advances_at_true_time(browse: Browse) -> None:
    def look(page: Page) -> None:
        in_view(page)
        assert state(page)["playing"] == "true"
        passed = canvas(page).evaluate(
            """canvas => new Promise(done => {
                const seen = [];
                const look = now => {
                    seen.push([now, Number(canvas.dataset.time)]);
                    if (seen.length < 240) requestAnimationFrame(look); else done(seen);
                };
                requestAnimationFrame(look);
            })"""
        )
        steps = [
            (b[0] - a[0], 1e3 * (b[1] - a[1]))
            for a, b in pairwise(passed)
            if a[1] < b[1] < 0.6 and b[0] - a[0] < 200
        ]
        assert len(steps) > 10
        by_clock, by_cut = map(sum, zip(*steps, strict=True))
        assert by_cut == pytest.approx(by_clock, rel=0.25)

    browse(look)


def test_it_pauses_scrubs_and_steps(browse: Browse) -> None:
    def look(page: Page) -> None:
        in_view(page)
        page.get_by_role("button", name="Pause", exact=True).click()
        paused = frame(page)
        picture = pixels(page)
        page.wait_for_timeout(300)
        assert frame(page) == paused
        assert pixels(page) == picture
        scrub(page, 0.2)
        assert state(page)["time"] == "0.2000"
        assert frame(page) == pytest.approx(200, abs=2)
        assert pixels(page) != picture
        arm = pixels(page, "arm")
        scrub(page, 0.45)
        assert pixels(page, "arm") != arm
        expect(page.locator(".value.time")).to_have_text("0.450 s")
        page.get_by_role("button", name="Play", exact=True).click()
        expect(canvas(page)).to_have_attribute("data-playing", "true")
        page.wait_for_function(
            "canvas => Number(canvas.dataset.time) > 0.47", arg=canvas(page).element_handle()
        )

    browse(look)


def test_the_keyboard_does_it_all(browse: Browse) -> None:
    def look(page: Page) -> None:
        in_view(page)
        page.locator(".cut-animation").focus()
        page.keyboard.press("Space")
        assert state(page)["playing"] == "false"
        page.keyboard.press("Home")
        assert frame(page) == 0
        page.keyboard.press("ArrowUp")
        page.keyboard.press("ArrowRight")
        end = int(state(page)["frames"]) - 1
        assert frame(page) == pytest.approx(0.11 * end, abs=1)
        page.keyboard.press("ArrowLeft")
        page.keyboard.press("ArrowDown")
        assert frame(page) == 0
        page.keyboard.press("End")
        assert frame(page) == end
        page.keyboard.press("Space")
        assert state(page)["playing"] == "true"

    browse(look)


def test_errors_are_magnified_about_the_wanted_path(browse: Browse) -> None:
    def look(page: Page) -> None:
        in_view(page)
        page.get_by_role("button", name="Pause", exact=True).click()
        scrub(page, 0.25)
        near, true = point(page, "nominal"), point(page, "identified")
        slider = page.get_by_role("slider", name="Magnify errors")
        slider.focus()
        slider.press("ArrowRight")
        slider.press("ArrowRight")
        assert state(page)["magnification"] == "5"
        assert state(page)["time"] == "0.2500"
        far, still = point(page, "nominal"), point(page, "identified")
        # The identified tool is within 0.1 mm of the wanted one, from which both move away fivefold.
        for axis in (0, 1):
            assert far[axis] - true[axis] == pytest.approx(5 * (near[axis] - true[axis]), abs=0.5)
            assert still[axis] == pytest.approx(true[axis], abs=0.5)

    browse(look)


def test_another_setting_shows_another_path_and_keeps_the_moment(browse: Browse) -> None:
    def look(page: Page) -> None:
        in_view(page)
        page.get_by_role("button", name="Pause", exact=True).click()
        page.locator(".speed select").select_option("1/10")
        scrub(page, 0.25)
        before, picture = point(page, "nominal"), pixels(page)
        page.get_by_test_id("stMain").get_by_text("3 K", exact=True).click()
        expect(page.locator(".nominal-name")).to_have_text("nominal (3 K)")
        finished(page)
        after = point(page, "nominal")
        assert abs(after[0] - before[0]) + abs(after[1] - before[1]) > 0.5
        assert pixels(page) != picture
        now = state(page)
        assert (now["time"], now["playing"], now["speed"]) == ("0.2500", "false", "0.1")
        # One loop runs, not two: at a tenth of the speed, the cut takes ten times as long.
        page.get_by_role("button", name="Play", exact=True).click()
        page.wait_for_timeout(500)
        assert 0.26 < float(state(page)["time"]) < 0.36

    browse(look)


def test_who_wants_no_motion_sees_the_finished_cut(browse: Browse) -> None:
    def look(page: Page) -> None:
        now = state(page)
        assert now["playing"] == "false"
        assert int(now["frame"]) == int(now["frames"]) - 1
        page.get_by_role("button", name="Play", exact=True).click()
        in_view(page)
        expect(canvas(page)).to_have_attribute("data-playing", "true")

    browse(look, reduced_motion="reduce")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_on_a_phone_in_either_theme(browse: Browse, scheme: str) -> None:
    def look(page: Page) -> None:
        main = "(() => { const m = document.querySelector('[data-testid=stMain]');"
        assert page.evaluate(main + " return m.scrollWidth - m.clientWidth; })()") <= 0
        near, whole = canvas(page).bounding_box(), page.locator("canvas.arm").bounding_box()
        assert 300 < near["width"] <= 390
        assert whole["y"] > near["y"] + near["height"]  # one below the other
        colour = page.locator(".key.identified").evaluate("e => getComputedStyle(e).borderTopColor")
        assert colour == {"light": "rgb(0, 114, 178)", "dark": "rgb(86, 180, 233)"}[scheme]

    browse(look, viewport=PHONE, color_scheme=scheme)


def test_the_figure_is_saved_as_svg(browse: Browse) -> None:
    def look(page: Page) -> None:
        with page.expect_download() as download:
            page.get_by_role("button", name="Save the figure (.svg)").click()
        text = Path(download.value.path()).read_text("utf-8")
        assert text.startswith("<svg")
        assert text.count("<path") == 12
        assert page.locator("img[src^='data:image/svg+xml']").count() == 6
        sizes = page.locator("img[src^='data:image/svg+xml']").evaluate_all(
            "all => all.map(image => image.naturalWidth)"
        )
        assert all(size > 0 for size in sizes)

    browse(look)
