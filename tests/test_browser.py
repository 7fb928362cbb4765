"""The app in a real browser: what only a browser shows."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal
from urllib.parse import urlsplit

import pytest
from clicks import choose
from playwright.sync_api import BrowserContext, Page, Request, expect, sync_playwright

from jointid import Study
from jointid.study_files import pack_study

pytestmark = pytest.mark.browser

ROOT = Path(__file__).parents[1]
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--no-first-run",
]
PAGES = {
    "": "Test cell with 2 joint(s)",
    "Records": "Records",
    "Phasors": "Phasors",
    "Transfer_matrix": "Transfer matrix",
    "Elasticity": "Elasticity",
    "Cut": "Cut",
    "Plan": "Next experiment",
    "Report": "Report and export",
    "Simulate": "Simulate a robot",
    "Import_a_log": "Import a log",
}
PATIENCE_MS = 30_000
MEASURED_COLOUR = (
    "document.querySelector('.js-plotly-plot').data.find(t => t.name === 'measured').marker.color"
)

# On a page's own address streamlit's client first asks there for its server, then at the root.
PROBE = re.compile(r"http://127\.0\.0\.1:\d+/\w+/_stcore/(health|host-config)")


@pytest.fixture(scope="session")
def tree(sample_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The app as it stands, with the tests' sample studies beside it."""
    tree = tmp_path_factory.mktemp("app")
    for name in ("app.py", "pages", "jointid", ".streamlit"):
        (tree / name).symlink_to(ROOT / name)
    (tree / "sample_data").symlink_to(sample_folder)
    return tree


@pytest.fixture(scope="session")
def fresh_server(tree: Path) -> Iterator[Callable[[], str]]:
    """Start a server; each call starts another."""
    running: list[subprocess.Popen[bytes]] = []

    def start() -> str:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        command = [sys.executable, "-m", "streamlit", "run", "app.py", "--server.port", str(port)]
        command += ["--server.fileWatcherType", "none"]
        silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        running.append(subprocess.Popen(command, cwd=tree, **silent))
        address = f"http://127.0.0.1:{port}"
        for _ in range(300):
            try:
                with urllib.request.urlopen(f"{address}/_stcore/health", timeout=5):
                    return address
            except (urllib.error.URLError, ConnectionError):
                time.sleep(0.1)
        raise AssertionError("The server did not come up.")

    yield start
    for server in running:
        server.terminate()
    for server in running:
        server.wait(timeout=20)


@pytest.fixture(scope="session")
def address(fresh_server: Callable[[], str]) -> str:
    """One server for the tests that do not need it fresh."""
    return fresh_server()


@pytest.fixture(scope="session")
def browser(chromium: str) -> Iterator[BrowserContext]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        yield browser.new_context()  # one for all: the client's code is parsed once
        browser.close()


class Watch:
    """What went wrong in a page."""

    def __init__(self, page: Page) -> None:
        self.errors: list[str] = []
        self.abroad: list[str] = []
        page.on("console", lambda message: self._console(message.type, message.text, message.location))
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("request", self._request)

    def _console(self, kind: str, text: str, location: object) -> None:
        url = location.get("url", "") if isinstance(location, dict) else ""
        if kind == "error" and not PROBE.fullmatch(str(url)):
            self.errors.append(f"{text} ({url})")

    def _request(self, request: Request) -> None:
        parts = urlsplit(request.url)
        if parts.scheme not in ("data", "blob") and parts.hostname != "127.0.0.1":
            self.abroad.append(request.url)


@pytest.fixture
def open_in(browser: BrowserContext) -> Iterator[Callable[..., Page]]:
    """Open an address in a new tab; afterwards nothing may have gone wrong or left the machine."""
    watches: list[Watch] = []
    pages: list[Page] = []

    def open_address(
        url: str, *, width: int = 1440, height: int = 900, scheme: Literal["light", "dark"] = "light"
    ) -> Page:
        page = browser.new_page()
        page.set_viewport_size({"width": width, "height": height})
        page.emulate_media(color_scheme=scheme)
        page.set_default_timeout(PATIENCE_MS)
        pages.append(page)
        watches.append(Watch(page))
        page.goto(url, wait_until="commit")
        return page

    yield open_address
    for page in pages:
        page.close()
    for watch in watches:
        assert watch.errors == []
        assert watch.abroad == []


def finished(page: Page, title: str) -> None:
    """Wait until the page has its title and its script has ended."""
    expect(page.get_by_role("heading", level=1)).to_have_text(title, timeout=PATIENCE_MS)
    expect(page.get_by_test_id("stApp")).to_have_attribute(
        "data-test-script-state", "notRunning", timeout=PATIENCE_MS
    )
    expect(page.get_by_test_id("stException")).to_have_count(0)


def figures(page: Page, count: int) -> None:
    expect(page.locator(".js-plotly-plot .main-svg").first).to_be_visible(timeout=PATIENCE_MS)
    expect(page.locator(".js-plotly-plot")).to_have_count(count, timeout=PATIENCE_MS)


@pytest.mark.parametrize("path", list(PAGES)[1:])
def test_a_fresh_server_opens_every_page_by_its_address(
    fresh_server: Callable[[], str], open_in: Callable[..., Page], path: str
) -> None:
    page = open_in(f"{fresh_server()}/{path}")
    finished(page, PAGES[path])
    assert not page.get_by_text("Page not found").count()


def test_the_first_screen_shows_answer_and_figures(
    fresh_server: Callable[[], str], open_in: Callable[..., Page]
) -> None:
    page = open_in(fresh_server())
    finished(page, PAGES[""])
    expect(page.get_by_test_id("stMetric")).to_have_count(4)
    figures(page, 2)
    assert page.evaluate(MEASURED_COLOUR) == "#000000"


def test_study_and_settings_survive_links_and_a_refresh(
    address: str, open_in: Callable[..., Page]
) -> None:
    page = open_in(f"{address}/Elasticity?study=three+joints")
    finished(page, "Elasticity")
    choose(page, "Estimator", "least-squares")
    expect(page.get_by_text("Shown on every page: least-squares")).to_be_visible()
    sidebar = page.get_by_test_id("stSidebar")
    sidebar.get_by_role("link", name="Study", exact=True).click()
    finished(page, "Test cell with 3 joint(s)")
    sidebar.get_by_role("link", name="Elasticity").click()
    finished(page, "Elasticity")
    for _ in range(2):
        expect(page.get_by_role("combobox", name="Study")).to_have_value("three joints")
        expect(page.get_by_test_id("stMetric")).to_have_count(6)
        expect(page.get_by_text("Shown on every page: least-squares")).to_be_visible()
        page.reload(wait_until="commit")
        finished(page, "Elasticity")


def test_a_study_of_ones_own_is_opened(
    address: str, open_in: Callable[..., Page], studies: dict[int, Study]
) -> None:
    page = open_in(address)
    finished(page, PAGES[""])
    page.get_by_role("button", name="Open a study (.zip)").click()
    file = {"name": "mine.zip", "mimeType": "application/zip", "buffer": pack_study(studies[1])}
    page.locator("input[type=file]").set_input_files(file)
    finished(page, "Test cell with 1 joint(s)")
    page.keyboard.press("Escape")
    page.get_by_test_id("stSidebar").get_by_role("link", name="Records").click()
    finished(page, "Records")
    expect(page.get_by_role("combobox", name="Study")).to_have_value("mine.zip")
    figures(page, 3)


def test_a_refused_file_leaves_the_study_in_place(address: str, open_in: Callable[..., Page]) -> None:
    page = open_in(address)
    finished(page, PAGES[""])
    page.get_by_role("button", name="Open a study (.zip)").click()
    file = {"name": "bad.zip", "mimeType": "application/zip", "buffer": b"no archive"}
    page.locator("input[type=file]").set_input_files(file)
    expect(page.get_by_text("bad.zip was not opened")).to_be_visible()
    finished(page, PAGES[""])


def test_a_log_becomes_a_record(address: str, open_in: Callable[..., Page], jittered_log: bytes) -> None:
    page = open_in(f"{address}/Import_a_log")
    finished(page, PAGES["Import_a_log"])
    file = {"name": "actuator.csv", "mimeType": "text/csv", "buffer": jittered_log}
    page.get_by_test_id("stMain").locator("input[type=file]").set_input_files(file)
    page.get_by_role("textbox", name="Rotor inertias").fill("0.001")
    page.get_by_role("textbox", name="Arm inertia").fill("0.002")
    page.get_by_role("button", name="Open as study").click()
    finished(page, "actuator")
    page.get_by_test_id("stSidebar").get_by_role("link", name="Records").click()
    finished(page, "Records")
    figures(page, 3)


def test_a_long_simulation_can_be_stopped(address: str, open_in: Callable[..., Page]) -> None:
    page = open_in(f"{address}/Simulate")
    finished(page, PAGES["Simulate"])
    page.get_by_label("Length of a record (s)").fill("25")
    page.get_by_label("Frequencies", exact=True).fill("50")
    page.get_by_role("button", name="Simulate", exact=True).click()
    expect(page.get_by_text("Simulating 100 records")).to_be_visible(timeout=PATIENCE_MS)
    page.get_by_role("button", name="Stop", exact=True).click()
    expect(page.get_by_text("Simulating 100 records")).to_have_count(0, timeout=PATIENCE_MS)
    finished(page, PAGES["Simulate"])
    expect(page.get_by_role("combobox", name="Study")).to_have_value("paper")


def test_nothing_is_wider_than_a_phone(address: str, open_in: Callable[..., Page]) -> None:
    page = open_in(address, width=390, height=844)
    for path, title in PAGES.items():
        page.goto(f"{address}/{path}", wait_until="commit")
        finished(page, title)
        wide = "(() => { const m = document.querySelector('[data-testid=stMain]');"
        assert page.evaluate(wide + " return m.scrollWidth - m.clientWidth; })()") <= 0, title


def test_measured_points_are_white_on_a_dark_theme(address: str, open_in: Callable[..., Page]) -> None:
    page = open_in(address, scheme="dark")
    finished(page, PAGES[""])
    figures(page, 2)
    assert page.evaluate(MEASURED_COLOUR) == "#FFFFFF"
