"""Check an installed jointid in an empty folder: a sample by name, then every page of the app.

PYTHONPATH=tests python .ci/check_installed.py VENV/bin/jointid
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
import tomllib
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sessions import Session

from jointid.files.application import __version__, sample_studies

ROOT = Path(__file__).parents[1]
START_S = 60


def check_commands(jointid: Path, folder: Path) -> None:
    """Ask for the version, and identify a sample by its name."""
    said = subprocess.run([jointid, "--version"], cwd=folder, check=True, capture_output=True, text=True)
    assert said.stdout == f"jointid {__version__}\n", said.stdout
    command = [jointid, "identify", "paper", "--json"]
    found = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
    print("jointid identify paper: K =", json.loads(found.stdout)["K"])


@contextmanager
def served(jointid: Path, folder: Path) -> Iterator[str]:
    """Run the app as a person would, and end it by Ctrl-C; yields its address."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    address = f"http://127.0.0.1:{port}"
    command = [jointid, "app", "--port", str(port)]
    with tempfile.TemporaryDirectory() as data:
        environment = os.environ | {"JOINTID_DATA_DIR": data}
        process = subprocess.Popen(command, cwd=folder, env=environment, start_new_session=True)
        try:
            _wait_for(f"{address}/_stcore/health", process)
            yield address
            os.killpg(process.pid, signal.SIGINT)
            assert process.wait(timeout=20) == 0
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()


def _wait_for(address: str, process: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + START_S
    while True:
        try:
            with urllib.request.urlopen(address, timeout=5):
                return
        except OSError:
            assert process.poll() is None, f"The app ended with code {process.returncode}."
            assert time.monotonic() < until, f"No server within {START_S} s."
            time.sleep(0.1)


def check_app(address: str) -> None:
    """Visit every page and every sample; compare the theme with the checkout's configuration."""
    with urllib.request.urlopen(address, timeout=5) as answer:
        assert b"<title>" in answer.read()
    session = Session(address)
    pages = sorted(file.stem.partition("_")[2] for file in (ROOT / "pages").glob("*.py"))
    for page in ["", *pages]:
        print(f"page {page or 'Study'}:", _title(session, page))
    names = {page.page_name for page in session.begun.app_pages}
    assert names == {"app", *(page.replace("_", " ") for page in pages)}, names
    for name in sample_studies():
        session = Session(address)
        print(f"sample {name}:", _title(session, "", f"study={name.replace('_', '+')}"))
    theme = tomllib.loads((ROOT / ".streamlit" / "config.toml").read_text("utf-8"))["theme"]
    assert session.begun.custom_theme.light.primary_color == theme["light"]["primaryColor"]
    assert session.begun.custom_theme.metric_value_font_size == theme["metricValueFontSize"]


def _title(session: Session, page: str, query: str = "") -> str:
    elements = session.run(page, query)
    exceptions = [e.exception.message for e in elements if e.HasField("exception")]
    assert not exceptions, exceptions
    titles = {e.heading.body for e in elements if e.HasField("heading") and e.heading.tag == "h1"}
    assert len(titles) == 1, titles  # once, or again where the page asked for another run
    return str(titles.pop())


if __name__ == "__main__":
    program = Path(sys.argv[1]).absolute()
    os.environ.pop("PYTHONPATH", None)  # of this script; the program has an environment of its own
    with tempfile.TemporaryDirectory() as empty:
        check_commands(program, Path(empty))
        with served(program, Path(empty)) as address:
            check_app(address)
        left = sorted(path.name for path in Path(empty).iterdir())
        assert not left, left
    print("The installed wheel works from an empty folder.")
