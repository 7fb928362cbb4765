"""Shared by all browser tests: the served app, and a browser that records errors."""

from __future__ import annotations

import functools
import os
import random
import re
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from playwright.sync_api import (
    Browser,
    BrowserContext,
    ConsoleMessage,
    Page,
    Request,
    WebSocket,
    expect,
    sync_playwright,
)
from streamlit.proto.BackMsg_pb2 import BackMsg
from streamlit.proto.ForwardMsg_pb2 import ForwardMsg

ROOT = Path(__file__).parents[1]
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--no-first-run",
    "--process-per-site",
]
PATIENCE_MS = 90_000
expect.set_options(timeout=PATIENCE_MS)  # 5 s is too short where the cores have other work

# On a page's own address streamlit's client first asks there for its server, then at the root.
PROBE = re.compile(r"http://127\.0\.0\.1:\d+/\w+/_stcore/(health|host-config)")


def free_port() -> int:
    """A free port that no client is given, so that it stays free until the server is started again."""
    for port in random.sample(range(20_000, 32_000), 100):
        with socket.socket() as probe, suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port
    raise AssertionError("No port is free.")


class Server:
    """The app in a folder of its own; it can be killed and started again at the same address."""

    def __init__(self, folder: Path, data: Path) -> None:
        self.port = free_port()
        self.folder, self.data = folder, data
        self.address = f"http://127.0.0.1:{self.port}"
        self.start()

    def begin(self) -> Any:
        """Begin a process, which can be killed and awaited."""
        command = [sys.executable, "-m", "jointid.ui.server", "app.py", str(self.port)]
        environment = os.environ | {"JOINTID_DATA_DIR": str(self.data)}
        silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        return subprocess.Popen(command, cwd=self.folder, env=environment, **silent)

    def start(self) -> None:
        self.process = self.begin()
        for _ in range(20 * PATIENCE_MS // 1000):
            try:
                with urllib.request.urlopen(f"{self.address}/_stcore/health", timeout=5):
                    return
            except (urllib.error.URLError, ConnectionError):
                time.sleep(0.05)
        self.kill()
        raise AssertionError("The server did not come up.")

    def kill(self) -> None:
        """End it at once, as a power cut would."""
        self.process.kill()
        self.process.wait()


_open = ExitStack()


@functools.cache
def kept_browser(chromium: str) -> Browser:
    """The browser of this process, which begins now unless it runs already."""
    playwright = _open.enter_context(sync_playwright())
    return _open.enter_context(playwright.chromium.launch(executable_path=chromium, args=FLAGS))


@functools.cache
def kept_context(chromium: str) -> BrowserContext:
    """Its storage is shared by all tests of a server; servers differ in their ports.

    With ``--process-per-site`` all tabs of a context share one process, which lives as long as one of
    them: the empty tab that stays open keeps the client's code compiled.
    """
    context = _open.enter_context(kept_browser(chromium).new_context())
    page = context.new_page()
    page.route("**", lambda route: route.fulfill(body=""))
    page.goto("http://127.0.0.1/")
    return context


def close_browser() -> None:
    _open.close()
    kept_browser.cache_clear()
    kept_context.cache_clear()


class Watch:
    """Errors of a page, and its requests to other machines."""

    def __init__(self, page: Page) -> None:
        self.errors: list[str] = []
        self.abroad: list[str] = []
        page.on("console", self._console)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("request", self._request)

    def check(self) -> None:
        assert self.errors == []
        assert self.abroad == []

    def _console(self, message: ConsoleMessage) -> None:
        url = str(message.location.get("url", ""))
        if message.type == "error" and not PROBE.fullmatch(url):
            self.errors.append(f"{message.text} ({url})")

    def _request(self, request: Request) -> None:
        parts = urlsplit(request.url)
        if parts.scheme not in ("data", "blob") and parts.hostname != "127.0.0.1":
            self.abroad.append(request.url)


class Runs:
    """The runs of a page's script: asked for, begun and ended, as its connection tells.

    The page itself says "notRunning" too early: before the server has heard of a click, between a run
    and the one that ``st.rerun`` asks for, and while a fragment is about to ask for a run by itself.
    """

    QUIET_S = 0.05
    """What has come in is drawn after this time."""

    def __init__(self, page: Page) -> None:
        self.asked = 0
        """Number of runs that the page has requested after user input."""
        self.waits = True
        """Whether the latest of them has not begun."""
        self._runs = self._asks_again = False
        self._heard = time.monotonic()
        page.on("request", self._request)
        page.on("websocket", self._listen)

    @property
    def over(self) -> bool:
        """Whether the page is idle until the next input."""
        quiet = time.monotonic() - self._heard > self.QUIET_S
        return quiet and not (self.waits or self._runs or self._asks_again)

    def _request(self, request: Request) -> None:
        if request.is_navigation_request():
            self.waits, self._runs, self._asks_again = True, False, False
            self._heard = time.monotonic()

    def _listen(self, connection: WebSocket) -> None:
        connection.on("framesent", self._sent)
        connection.on("framereceived", self._received)

    def _sent(self, frame: bytes | str) -> None:
        message = BackMsg.FromString(frame) if isinstance(frame, bytes) else BackMsg()
        if message.HasField("rerun_script") and not message.rerun_script.is_auto_rerun:
            self.asked += 1
            self.waits = True
            self._heard = time.monotonic()

    def _received(self, frame: bytes | str) -> None:
        message = ForwardMsg.FromString(frame) if isinstance(frame, bytes) else ForwardMsg()
        match message.WhichOneof("type"):
            case "new_session":
                self._runs = True
                if not message.metadata.run.fragment_ids:
                    self.waits = self._asks_again = False
            case "auto_rerun":
                self._asks_again = True
            case "script_finished":
                self._runs = message.script_finished == ForwardMsg.FINISHED_EARLY_FOR_RERUN
            case _:
                pass
        self._heard = time.monotonic()


_runs: dict[Page, Runs] = {}


def new_page(context: BrowserContext) -> Page:
    """A tab whose runs are followed; every page that is waited for is made by this."""
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    _runs[page] = Runs(page)
    page.on("close", lambda page: _runs.pop(page, None))
    return page


def _wait(page: Page, condition: Callable[[], bool], problem: str) -> None:
    until = time.monotonic() + PATIENCE_MS / 1e3
    while not condition():
        assert time.monotonic() < until, problem
        page.wait_for_timeout(10)  # what the connection tells comes in meanwhile


def rested(page: Page) -> None:
    """Wait until the page is idle; it must show no exception."""
    runs = _runs[page]
    _wait(page, lambda: runs.over, "The page's script did not come to an end.")
    app = page.get_by_test_id("stApp")
    expect(app).to_have_attribute("data-test-script-state", "notRunning")
    # Each kind of element is drawn by a script of its own, which comes when the first one is needed.
    expect(page.locator("[data-testid=stSkeleton], [data-stale=true]")).to_have_count(0)
    expect(page.get_by_test_id("stException")).to_have_count(0)


@contextmanager
def heard(page: Page) -> Iterator[None]:
    """Act on an idle page, and wait until the server has begun to run for it.

    What the page has only sent is lost if it asks for another page before the run begins.
    """
    rested(page)
    runs, before = _runs[page], _runs[page].asked
    yield
    _wait(page, lambda: runs.asked > before and not runs.waits, "The server heard nothing of it.")


@contextmanager
def answered(page: Page) -> Iterator[None]:
    """Act on an idle page, and wait until the server has answered."""
    with heard(page):
        yield
    rested(page)


def finished(page: Page, title: str) -> None:
    """Wait until the page has its title and is idle."""
    expect(page.get_by_role("heading", level=1)).to_have_text(title)
    rested(page)


def choose(page: Page, box: str, option: str) -> None:
    """Pick an option of a select box."""
    select = page.get_by_role("combobox", name=box)
    with answered(page):
        # A click that has to scroll closes the list again that it opens: scrolling closes lists.
        select.scroll_into_view_if_needed()
        select.evaluate("() => new Promise(requestAnimationFrame)")
        select.click()
        select.fill(option)  # a long list holds only what is in view
        page.get_by_role("option", name=option, exact=True).click()
    expect(select).to_have_value(option)


def follow(page: Page, link: str, title: str) -> None:
    """Go to another page by its link in the sidebar, whatever the page is still doing."""
    page.get_by_test_id("stSidebar").get_by_role("link", name=link, exact=True).click()
    finished(page, title)


def drop_study(page: Page, name: str, data: bytes) -> None:
    """Give a file to the sidebar; the page's runs go on by themselves."""
    page.get_by_role("button", name="Open a study (.zip)").click()
    uploader = page.get_by_test_id("stPopoverBody").locator("input[type=file]")
    uploader.set_input_files({"name": name, "mimeType": "application/zip", "buffer": data})


def open_file(page: Page, name: str, data: bytes) -> None:
    """Open a study by the sidebar."""
    with answered(page):
        drop_study(page, name, data)
    page.keyboard.press("Escape")
    expect(page.get_by_test_id("stPopoverBody")).to_have_count(0)


def too_wide(page: Page) -> int:
    """By how many pixels the page is wider than its window."""
    main = "(() => { const m = document.querySelector('[data-testid=stMain]');"
    return int(page.evaluate(main + " return m.scrollWidth - m.clientWidth; })()"))
