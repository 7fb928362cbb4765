"""Import in Chromium, from the upload to the report, by keyboard, with a reload and a kill."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from browsing import Server, answered, finished, new_page, rested
from log_makers import Log, as_csv, two_joint_log, zipped
from plants import PAPER
from playwright.sync_api import BrowserContext, FileChooser, Locator, Page, expect

pytestmark = pytest.mark.browser

RATIOS, RATED_NM = (100.0, -90.0), (5.0, 2.0)
ENTRIES = {"Gear ratios, one per joint": "100, -90", "Rated torque (N·m), one per joint": "5, 2"}
"""What the file of the cell does not say."""
M, M2 = "0.0025, 0.0010", "0.004104, 0.000395; 0.000395, 0.001889"


@pytest.fixture(scope="module")
def log() -> Log:
    return two_joint_log()


@pytest.fixture(scope="module")
def shared(new_server: Callable[[], Server]) -> Iterator[Server]:
    server = new_server()
    yield server
    server.kill()


def values(page: Page) -> dict[str, float]:
    """The tiles of the first page: K1, D1, K2, D2."""
    tiles = page.get_by_test_id("stMetric")
    expect(tiles).to_have_count(4)
    found = {}
    for text in tiles.all_inner_texts():
        name, value = re.search(r"([KD]\d)\D*?\s([\d.]+)", text.replace("\n", " ")).groups()  # type: ignore[union-attr]
        found[name] = float(value)
    return found


def rotors(page: Page) -> Locator:
    return page.get_by_role("textbox", name="Rotor inertias M, one per joint")


def held(page: Page) -> Locator:
    return page.get_by_role("radio", name="held until the next sample")


def near_the_truth(page: Page) -> None:
    found = values(page)
    truth = {f"{name}{j + 1}": float(getattr(PAPER, name)[j]) for name in "KD" for j in (0, 1)}
    assert found.keys() == truth.keys()
    for name, value in truth.items():
        assert found[name] == pytest.approx(value, rel=2e-3 if name[0] == "K" else 2e-2), found


def tab_to(page: Page, wanted: Locator) -> None:
    """Press Tab until an element has the focus; a page drawn anew meanwhile begins at its top again."""
    expect(wanted).to_have_count(1)
    for _ in range(400):
        if wanted.evaluate("e => e === document.activeElement"):
            return
        page.keyboard.press("Tab")
    raise AssertionError(f"Tab does not reach {wanted}.")


def press(page: Page, wanted: Locator, key: str = "Enter") -> None:
    """Go to an element by Tab, press a key there and wait for the answer."""
    tab_to(page, wanted)
    with answered(page):
        page.keyboard.press(key)


def type_in(page: Page, box: Locator, text: str) -> None:
    """Go to a box by Tab, enter a text and wait for the answer, which may draw the page anew."""
    tab_to(page, box)
    page.keyboard.press("Control+a")
    page.keyboard.type(text)
    with answered(page):
        page.keyboard.press("Enter")
    expect(box).to_have_value(text)


def keyed(context: BrowserContext, address: str) -> Page:
    """Open an address in a tab that notes whether a pointer was used."""
    page = new_page(context)
    page.add_init_script("addEventListener('pointerdown', () => window.touched = true, true)")
    page.goto(address, wait_until="commit")
    rested(page)
    page.bring_to_front()
    return page


def upload(page: Page, log: Log) -> None:
    button = page.get_by_test_id("stMain").get_by_role("button", name="Upload", exact=True)
    packed = zipped({"cell.csv": as_csv(log, RATIOS, RATED_NM)})
    chosen: list[FileChooser] = []
    page.once("filechooser", lambda each: chosen.append(each))
    for passed in range(150):
        if chosen:
            break
        if passed % 50 == 0:  # a page that is drawn again at this moment misses the key
            tab_to(page, button)
            page.keyboard.press("Enter")
        page.wait_for_timeout(200)
    with answered(page):
        chosen[0].set_files({"name": "cell.zip", "mimeType": "application/zip", "buffer": packed})
    expect(page.get_by_text("6 sine runs, 6 to 26 Hz")).to_be_visible()


def hold_torque(page: Page) -> None:
    """Say that the torque is held, and confirm what no log states."""
    press(page, held(page))
    press(page, page.get_by_role("button", name="Confirm the drive data"))


def entries_are_there(page: Page) -> None:
    """All that was entered, in a page that has only the address."""
    expect(page.locator("summary", has_text="cell.csv")).to_be_visible()
    finished(page, "Import a log")
    tab_to(page, page.locator("summary", has_text="3 Drive data"))
    page.keyboard.press("Enter")
    for name, text in ENTRIES.items():
        expect(page.get_by_role("textbox", name=name)).to_have_value(text)
    expect(held(page)).to_be_checked()
    expect(rotors(page)).to_have_value(M)


def make_report(page: Page) -> None:
    tab_to(page, page.get_by_test_id("stSidebar").get_by_role("link", name="Report and export"))
    page.keyboard.press("Enter")
    finished(page, "Report and export")
    press(page, page.get_by_role("button", name="Make the report"))
    tab_to(page, page.get_by_role("button", name="Report as PDF"))
    with page.expect_download() as download:
        page.keyboard.press("Enter")
    assert Path(download.value.path()).read_bytes().startswith(b"%PDF")


def test_by_keyboard_from_a_zipped_log_to_the_report_past_refresh_kill_and_a_closed_tab(
    log: Log, shared: Server, context: BrowserContext
) -> None:
    """Every kind of log gives K and D without a browser: ``test_import_readers.py``."""
    page = keyed(context, shared.address)
    tab_to(page, page.get_by_test_id("stSidebar").get_by_role("link", name="Import a log"))
    page.keyboard.press("Enter")
    finished(page, "Import a log")
    upload(page, log)
    for name, text in ENTRIES.items():
        type_in(page, page.get_by_role("textbox", name=name), text)
    hold_torque(page)
    type_in(page, rotors(page), M)
    assert page.evaluate("window.touched") is None
    page.reload(wait_until="commit")
    entries_are_there(page)
    drop_first_run(page)
    assert is_kept(shared, f'"import M": "{M}"')
    address = page.url
    shared.kill()
    page.close()
    shared.start()
    page = keyed(context, address)
    entries_are_there(page)
    type_in(page, page.get_by_role("textbox", name="Arm inertia M2"), M2)
    expect(page.get_by_text("Used by the method")).to_be_visible()
    tab_to(page, page.get_by_role("button", name="Open as study"))
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", level=1)).not_to_have_text("Import a log")
    rested(page)
    expect(page.get_by_text("5 records")).to_be_visible()
    near_the_truth(page)
    make_report(page)
    assert page.evaluate("window.touched") is None
    page.goto(address, wait_until="commit")
    finished(page, "Import a log")
    expect(page.get_by_text("Still open")).to_have_count(0)
    page.close()


def is_kept(server: Server, text: str) -> bool:
    """Whether the store holds an entry."""
    return any(text.encode() in file.read_bytes() for file in server.data.rglob("*.data"))


STILL = """async element => {
  for (let [place, same] = [NaN, 0]; same < 10; ) {
    await new Promise(requestAnimationFrame);
    const now = element.getBoundingClientRect().y;
    [place, same] = [now, now === place ? same + 1 : 0];
  }
}"""
"""Wait until what unfolds above an element has left it where it is for ten frames."""


def drop_first_run(page: Page) -> None:
    """Untick the first line of the table, whose cells are drawn on a canvas."""
    step = page.locator("summary", has_text="4 Runs")
    if step.locator("..").get_attribute("open") is None:
        step.click()
    table = page.get_by_test_id("stDataFrame").last
    expect(table).to_be_visible()
    for _ in range(2):  # the figure above it, drawn late, moves it away
        table.scroll_into_view_if_needed()
        table.evaluate(STILL)
    box = table.locator("canvas").first.bounding_box()
    assert box is not None
    with answered(page):
        page.mouse.click(box["x"] + 77, box["y"] + 52)
    left_out = page.locator(".js-plotly-plot .legendtext", has_text="left out")
    expect(left_out).to_be_visible()


def test_disabled_buttons_can_be_read_beside_their_reason(
    log: Log, shared: Server, context: BrowserContext
) -> None:
    page = new_page(context)
    page.goto(f"{shared.address}/Import_a_log", wait_until="commit")
    finished(page, "Import a log")
    file = {"name": "cell.csv", "mimeType": "text/csv", "buffer": as_csv(log, RATIOS, RATED_NM)}
    with answered(page):
        page.get_by_test_id("stMain").locator("input[type=file]").first.set_input_files(file)
    with answered(page):
        page.get_by_role("textbox", name="Gear ratios").fill("abc")
        page.keyboard.press("Enter")
    page.locator("summary", has_text="5 Inertias").click()
    button = page.get_by_role("button", name="Open as study")
    expect(button).to_be_disabled()
    expect(page.get_by_text('Step 3, Gear ratios: "abc" is not a number.')).to_be_visible()
    white = "rgb(255, 255, 255)"  # on the primary colour, which a disabled button does not have
    assert button.locator("p").evaluate("e => getComputedStyle(e).color") != white
    page.close()
