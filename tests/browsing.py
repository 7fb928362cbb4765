"""The app served, and a browser that watches what goes wrong: what all browser tests share."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from playwright.sync_api import ConsoleMessage, Page, Request, expect
from playwright.sync_api import Error as PlaywrightError

ROOT = Path(__file__).parents[1]
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--no-first-run",
]
PATIENCE_MS = 40_000

# On a page's own address streamlit's client first asks there for its server, then at the root.
PROBE = re.compile(r"http://127\.0\.0\.1:\d+/\w+/_stcore/(health|host-config)")


class Server:
    """The app in a folder of its own; it can be killed and started again at the same address."""

    def __init__(self, folder: Path, data: Path) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.folder, self.data = folder, data
        self.address = f"http://127.0.0.1:{self.port}"
        self.start()

    def start(self) -> None:
        command = [sys.executable, "-m", "streamlit", "run", "app.py", "--server.port", str(self.port)]
        command += ["--server.fileWatcherType", "none"]
        environment = os.environ | {"JOINTID_DATA_DIR": str(self.data)}
        silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self.process = subprocess.Popen(command, cwd=self.folder, env=environment, **silent)
        for _ in range(300):
            try:
                with urllib.request.urlopen(f"{self.address}/_stcore/health", timeout=5):
                    return
            except (urllib.error.URLError, ConnectionError):
                time.sleep(0.1)
        self.kill()
        raise AssertionError("The server did not come up.")

    def kill(self) -> None:
        """End it at once, as a power cut would."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait(timeout=20)


class Watch:
    """What went wrong in a page, and what it asked of other machines."""

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


def once_more(test: Callable[..., None]) -> Callable[..., None]:
    """Try a test of clicks and keys a second time: on a machine under load a browser may miss one."""

    @wraps(test)
    def tried(*arguments: Any, **named: Any) -> None:
        try:
            test(*arguments, **named)
        except (AssertionError, PlaywrightError):
            test(*arguments, **named)

    return tried


def rested(page: Page) -> None:
    """Wait until the page's script has ended, and find no exception on it."""
    expect(page.get_by_test_id("stApp")).to_have_attribute(
        "data-test-script-state", "notRunning", timeout=PATIENCE_MS
    )
    expect(page.get_by_test_id("stException")).to_have_count(0)


def finished(page: Page, title: str) -> None:
    """Wait until the page has its title and its script has ended."""
    expect(page.get_by_role("heading", level=1)).to_have_text(title, timeout=PATIENCE_MS)
    rested(page)


def too_wide(page: Page) -> int:
    """By how many pixels the page is wider than its window."""
    main = "(() => { const m = document.querySelector('[data-testid=stMain]');"
    return int(page.evaluate(main + " return m.scrollWidth - m.clientWidth; })()"))
