"""The app in real Chromium: start, first picture, page switch, slider to picture, memory, 20 sessions.

    python benchmarks/app.py [--quick] [--json FILE]

A rerun lasts from the person's key or click to the moment when the page says that its script has
ended, by the browser's own clock. Twenty persons have a study each, in contexts that share nothing, and
act again after some seconds. Browser and server share this machine, so that the twenty browser pages
load it as well; twenty persons' own computers would not.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import platform
import random
import shutil
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from playwright.async_api import Browser, Locator, Page, async_playwright

from jointid import (
    Controller,
    Elasticity,
    Excitation,
    Inertia,
    Measurement,
    Study,
    simulate_records,
)
from jointid.study_files import pack_study

ROOT = Path(__file__).parents[1]
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]
FLAGS += ["--no-first-run", "--disable-background-timer-throttling", "--disable-renderer-backgrounding"]
PATIENCE_MS = 120_000
PERSONS = 20
THINK_S = (2.0, 6.0)
"""Between two acts of one person; who reads takes longer."""
PAGES = ("Records", "Phasors", "Transfer matrix", "Elasticity", "Cut", "Next experiment", "Report")

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


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    what: str
    median: float
    p95: float | None
    unit: str
    count: int


def measure(quick: bool = False) -> list[Row]:
    """Measure everything; quickly means fewer repetitions and five persons."""
    return asyncio.run(_measure(quick))


async def _measure(quick: bool) -> list[Row]:
    repeat = 2 if quick else 5
    rows = []
    chromium = _chromium()
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        starts, first = [], []
        for _ in range(repeat):
            began = time.perf_counter()
            with served() as (address, _):
                starts.append(time.perf_counter() - began)
                first.append(await _first_picture(browser, address))
        rows += [row("server start", starts, "s"), row("first picture, cold server", first, "s")]
        with served() as (address, _):
            await _first_picture(browser, address)
            first = [await _first_picture(browser, address) for _ in range(repeat)]
            rows.append(row("first picture, another session", first, "s"))
            rows += await _one_person(browser, address, repeat)
        rows += await _crowd(browser, 5 if quick else PERSONS, 4 if quick else 24)
        await browser.close()
    return rows


async def _first_picture(browser: Browser, address: str) -> float:
    """From the address to tiles and a drawn figure, with an empty browser cache."""
    context = await browser.new_context(viewport={"width": 1440, "height": 900})
    page = await context.new_page()
    began = time.perf_counter()
    await page.goto(address, wait_until="commit")
    await page.wait_for_function(DRAWN, timeout=PATIENCE_MS)
    passed = time.perf_counter() - began
    await context.close()
    return passed


async def _one_person(browser: Browser, address: str, repeat: int) -> list[Row]:
    """Page switches, and the slider of the cut until the picture has changed."""
    page = await _visit(browser, address)
    found: dict[str, list[float]] = {}
    for turn in range(repeat + 1):
        for name in (*PAGES, "Study"):
            passed = await timed(page, lambda name=name: _link(page, name).click())
            key = f"page switch: {name}" + (", first time" if turn == 0 else "")
            found.setdefault(key, []).append(passed / 1e3)
    await timed(page, lambda: _link(page, "Cut").click())
    slider = page.get_by_role("slider", name="Corner zone")
    picture = page.locator("canvas.cut")
    for key, arrow in (("first time", "ArrowLeft"), ("seen before", "ArrowRight")):
        times, reruns = [], []
        for _ in range(repeat):
            await picture.evaluate(NOTE_DRAWING)
            reruns.append(await timed(page, lambda arrow=arrow: slider.press(arrow), settle=False) / 1e3)
            await page.wait_for_function("() => window.drawn !== null", timeout=PATIENCE_MS)
            times.append(float(await page.evaluate("() => window.drawn - window.actedAt")) / 1e3)
            await _rest(page)
        found[f"slider to picture, {key}"] = times
        found[f"slider to end of rerun, {key}"] = reruns
    await page.context.close()
    return [row(what, times, "s") for what, times in found.items()]


async def _crowd(browser: Browser, persons: int, acts: int) -> list[Row]:
    """Many persons with a study each: how long their reruns last, what a session takes."""
    with served() as (address, pid):
        first = await _visit(browser, address)
        alone = resident_MB(pid)
        await first.context.close()
        pages = [await _visit(browser, address) for _ in range(persons)]
        opened = resident_MB(pid)
        for k, page in enumerate(pages):
            await _upload(page, _study(k), f"person {k}.zip")
        with_studies = resident_MB(pid)
        for page in pages:
            await page.evaluate("() => { window.reruns = []; }")
        kinds: dict[str, list[float]] = {}
        began, worked = time.perf_counter(), cpu_s(pid)
        await asyncio.gather(*(_person(page, k, acts, kinds) for k, page in enumerate(pages)))
        passed, worked = time.perf_counter() - began, cpu_s(pid) - worked
        used = resident_MB(pid)
        for k, page in enumerate(pages):
            await _sees_its_own(page, k)
        for page in pages:
            await page.context.close()
    every = [x for times in kinds.values() for x in times]
    crowd = f"{persons} sessions"
    rows = [row(f"{crowd}: rerun, every kind", every, "s")]
    rows += [row(f"{crowd}: {kind}", times, "s") for kind, times in sorted(kinds.items())]
    return [
        *rows,
        # However busy the machine is with other things, these two say what the app asks of it.
        Row(f"{crowd}: server's processor time per rerun", worked / len(every), None, "s", len(every)),
        Row(f"{crowd}: processors that the server keeps busy", worked / passed, None, "", len(every)),
        Row("server memory, one session", alone, None, "MB", 1),
        Row("memory per further session", (opened - alone) / persons, None, "MB", persons),
        Row("same, with a study of its own", (with_studies - alone) / persons, None, "MB", persons),
        Row("same, after all pages were used", (used - alone) / persons, None, "MB", persons),
    ]


async def _person(page: Page, number: int, acts: int, kinds: dict[str, list[float]]) -> None:
    """Look at one page after the other, change a setting on each, and think in between."""
    rng = random.Random(number)
    await asyncio.sleep(rng.uniform(0, THINK_S[1]))
    for act in range(acts):
        name = PAGES[(number + act // 2) % len(PAGES)]
        change = CHANGES.get(name) if act % 2 else None
        if change is None:
            kind = f"page switch: {name}"
            passed = await timed(page, lambda name=name: _link(page, name).click())
        else:
            kind, do = change
            passed = await timed(page, lambda do=do: do(page))
        kinds.setdefault(kind, []).append(passed / 1e3)
        await asyncio.sleep(rng.uniform(*THINK_S))


async def _next_record(page: Page) -> None:
    await page.get_by_role("combobox", name="Record").first.focus()
    await page.keyboard.press("ArrowDown")
    await page.keyboard.press("ArrowDown")
    await page.keyboard.press("Enter")


async def _next_element(page: Page) -> None:
    await page.get_by_role("group", name="Element").get_by_role("button").nth(1).press("Enter")


async def _estimator(page: Page) -> None:
    await page.get_by_role("combobox", name="Estimator").focus()
    await page.keyboard.press("ArrowDown")
    await page.keyboard.press("ArrowDown")
    await page.keyboard.press("Enter")


async def _zone(page: Page) -> None:
    await page.get_by_role("slider", name="Corner zone").press("ArrowLeft")


CHANGES: dict[str, tuple[str, Callable[[Page], Awaitable[None]]]] = {
    "Records": ("another record", _next_record),
    "Phasors": ("another record's arrows", _next_record),
    "Elasticity": ("another estimator", _estimator),
    "Cut": ("another corner zone", _zone),
}


async def timed(page: Page, act: Callable[[], Awaitable[None]], *, settle: bool = True) -> float:
    """Act and return the milliseconds until the script has ended."""
    seen = await page.evaluate("() => window.reruns.length")
    await act()
    await page.wait_for_function("n => window.reruns.length > n", arg=seen, timeout=PATIENCE_MS)
    passed = float(await page.evaluate("n => window.reruns[n]", seen))
    if settle:
        await _rest(page)
    return passed


async def _rest(page: Page) -> None:
    await page.wait_for_function(RESTED, timeout=PATIENCE_MS)
    await page.wait_for_timeout(300)
    await page.wait_for_function(RESTED, timeout=PATIENCE_MS)


async def _visit(browser: Browser, address: str) -> Page:
    context = await browser.new_context(viewport={"width": 1440, "height": 900})
    page = await context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    await page.add_init_script(WATCH)
    await page.goto(address, wait_until="commit")
    await page.wait_for_function(DRAWN, timeout=PATIENCE_MS)
    await _rest(page)
    return page


async def _upload(page: Page, study: Study, name: str) -> None:
    await page.get_by_role("button", name="Open a study (.zip)").click()
    file = {"name": name, "mimeType": "application/zip", "buffer": pack_study(study)}
    await page.locator("input[type=file]").set_input_files(file)  # type: ignore[arg-type]
    await page.get_by_role("heading", level=1, name=study.name).wait_for()
    await page.keyboard.press("Escape")
    await _rest(page)


async def _sees_its_own(page: Page, number: int) -> None:
    """The study and the stiffness of this person, of nobody else."""
    await timed(page, lambda: _link(page, "Study").click())
    title = await page.get_by_role("heading", level=1).inner_text()
    tile = await page.get_by_test_id("stMetricValue").first.inner_text()
    found, wanted = float(tile.split("±")[0]), _truth(number).K[0]
    if title.strip() != f"Person {number}" or abs(found / wanted - 1) > 0.01:
        raise AssertionError(f"Person {number} sees {title}, K1 = {tile}; expected {wanted:g}.")


def _link(page: Page, name: str) -> Locator:
    return page.get_by_test_id("stSidebar").get_by_role("link", name=name, exact=True)


def _truth(number: int) -> Elasticity:
    return Elasticity(K=[30.0 + number, 6.0 + 0.1 * number], D=[0.10, 0.015])


def _study(number: int) -> Study:
    """A campaign of a robot that nobody else has."""
    inertia = Inertia(M=[0.0025, 0.0010], M2=[[0.004104, 0.000395], [0.000395, 0.001889]])
    truth = _truth(number)
    records = simulate_records(
        inertia,
        truth,
        np.geomspace(3.0, 30.0, 12).round(2),
        excitation=Excitation(duration_s=2.0),
        controller=Controller(sample_rate_hz=1000.0),
        measurement=Measurement(encoder_counts=1 << 20, torque_noise_Nm=0.005),
        seed=number,
    )
    nominal = Elasticity(K=0.5 * truth.K, D=truth.D)
    return Study(records, inertia, nominal, name=f"Person {number}", origin="simulated")


@contextmanager
def served() -> Iterator[tuple[str, int]]:
    """The app on a free port with an empty store; its address and process."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "streamlit", "run", "app.py", "--server.port", str(port)]
    command += ["--server.fileWatcherType", "none"]
    with tempfile.TemporaryDirectory() as store:
        environment = os.environ | {"JOINTID_DATA_DIR": store}
        silent: Any = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        server = subprocess.Popen(command, cwd=ROOT, env=environment, **silent)
        try:
            for _ in range(1200):
                try:
                    with urllib.request.urlopen(f"http://127.0.0.1:{port}/_stcore/health", timeout=5):
                        break
                except OSError:
                    time.sleep(0.05)
            else:
                raise RuntimeError("The server did not come up within a minute.")
            yield f"http://127.0.0.1:{port}", server.pid
        finally:
            server.terminate()
            server.wait(timeout=30)


def resident_MB(pid: int) -> float:
    """Memory that a process holds; not a number where /proc does not tell."""
    try:
        text = Path(f"/proc/{pid}/status").read_text("utf-8")
    except OSError:
        return float("nan")
    return next(int(line.split()[1]) / 1024 for line in text.splitlines() if line.startswith("VmRSS"))


def cpu_s(pid: int) -> float:
    """Processor time that a process took so far; not a number where /proc does not tell."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()
    except OSError:
        return float("nan")
    return (int(fields[11]) + int(fields[12])) / float(os.sysconf("SC_CLK_TCK"))


def row(what: str, values: Sequence[float], unit: str) -> Row:
    """Median and 95th percentile, the latter where there are enough values for one."""
    p95 = float(np.quantile(values, 0.95)) if len(values) >= 20 else None
    return Row(what, statistics.median(values), p95, unit, len(values))


def markdown(rows: Sequence[Row]) -> str:
    """The table."""
    lines = ["| what | median | 95th percentile | count |", "|---|---|---|---|"]
    for r in rows:
        p95 = "" if r.p95 is None else f"{r.p95:.3g} {r.unit}"
        lines.append(f"| {r.what} | {r.median:.3g} {r.unit}".rstrip() + f" | {p95} | {r.count} |")
    return "\n".join(lines)


def machine(load: float) -> str:
    """What it ran on, and how busy that was with other things before."""
    python = platform.python_version()
    return f"Python {python}, {os.cpu_count()} cores, {platform.machine()}, load before {load:.1f}."


def load_now() -> float:
    """Average number of processes that want a processor; not a number where nobody tells."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")


def _chromium() -> str:
    for name in ("chromium", "chromium-browser", "google-chrome"):
        if path := shutil.which(name):
            return path
    raise SystemExit("There is no chromium on the PATH.")


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure the app in real Chromium.")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions, five persons")
    parser.add_argument("--json", type=Path, help="also write the table as JSON")
    options = parser.parse_args()
    ran_on = machine(load_now())
    rows = measure(options.quick)
    print(f"{markdown(rows)}\n\n{ran_on}")
    if options.json:
        document = {"machine": ran_on, "rows": [asdict(r) for r in rows]}
        options.json.write_text(json.dumps(document, indent=2) + "\n", "utf-8")


if __name__ == "__main__":
    main()
