"""Import in Chromium, from the upload to K and D, with reloads in between."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest
from browsing import Server, answered, choose, finished, new_page, rested
from log_makers import Log, as_csv, two_joint_log, zipped
from plants import PAPER
from playwright.sync_api import BrowserContext, Locator, Page, expect

pytestmark = pytest.mark.browser

RATIOS, RATED_NM = (100.0, -90.0), (5.0, 2.0)
M, M2 = "0.0025, 0.0010", "0.004104, 0.000395; 0.000395, 0.001889"


@pytest.fixture(scope="module")
def log() -> Log:
    return two_joint_log()


@pytest.fixture(scope="module")
def shared(new_server: Callable[[], Server]) -> Iterator[Server]:
    server = new_server()
    yield server
    server.kill()


@pytest.fixture
def page(context: BrowserContext, shared: Server) -> Page:
    """A page in a tab of its own; what goes wrong while the server is dead is no fault."""
    page = new_page(context)
    page.goto(f"{shared.address}/Import_a_log", wait_until="commit")
    finished(page, "Import a log")
    return page


def upload(page: Page, name: str, data: bytes) -> None:
    file = {"name": name, "mimeType": "application/octet-stream", "buffer": data}
    with answered(page):
        page.get_by_test_id("stMain").locator("input[type=file]").first.set_input_files(file)
    expect(page.get_by_text("6 sine runs, 6 to 26 Hz")).to_be_visible()


def enter(page: Page, boxes: Sequence[tuple[Locator, str]]) -> None:
    """Fill boxes one after the other; leaving one sends it, and so does Enter in the last."""
    with answered(page):
        for box, value in boxes:
            box.fill(value)
        boxes[-1][0].press("Enter")
    for box, value in boxes:
        expect(box).to_have_value(value)


def hold_torque(page: Page) -> None:
    """Say that the torque is held, and confirm what no log states."""
    box = "Torque between samples"
    if not page.get_by_role("combobox", name=box).is_visible():
        page.get_by_text("3 Drive data").click()
    choose(page, box, "held until the next sample")
    with answered(page):
        page.get_by_role("button", name="Confirm the drive data").click()
    expect(page.get_by_text("torque held between samples")).to_be_visible()


def correct(page: Page) -> None:
    """What the file of the cell does not say."""
    texts = {"Gear ratios, one per joint": RATIOS, "Rated torque (N·m), one per joint": RATED_NM}
    boxes = [page.get_by_role("textbox", name=name) for name in texts]
    enter(
        page,
        [(box, ", ".join(f"{v:g}" for v in of)) for box, of in zip(boxes, texts.values(), strict=True)],
    )


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


def open_study(page: Page) -> None:
    enter(page, [(rotors(page), M), (page.get_by_role("textbox", name="Arm inertia M2"), M2)])
    expect(page.get_by_text("Used by the method")).to_be_visible()
    page.get_by_role("button", name="Open as study").click()
    expect(page.get_by_role("heading", level=1)).not_to_have_text("Import a log")


def near_the_truth(page: Page) -> None:
    found = values(page)
    truth = {f"{name}{j + 1}": float(getattr(PAPER, name)[j]) for name in "KD" for j in (0, 1)}
    assert found.keys() == truth.keys()
    for name, value in truth.items():
        assert found[name] == pytest.approx(value, rel=2e-3 if name[0] == "K" else 2e-2), found


def test_nothing_is_lost_by_refresh_kill_or_a_closed_tab(log: Log, page: Page, shared: Server) -> None:
    upload(page, "cell.csv", as_csv(log, RATIOS, RATED_NM))
    correct(page)
    page.reload(wait_until="commit")
    expect(page.locator("summary", has_text="cell.csv")).to_be_visible()
    rested(page)
    expect(page.get_by_role("textbox", name="Gear ratios")).to_have_value("100, -90")
    hold_torque(page)
    drop_first_run(page)
    enter(page, [(rotors(page), M)])
    assert is_kept(shared, f'"import M": "{M}"')
    address = page.url
    shared.kill()
    page.goto("about:blank")
    shared.start()
    again = new_page(page.context)
    again.goto(address, wait_until="commit")
    expect(again.locator("summary", has_text="cell.csv")).to_be_visible()
    finished(again, "Import a log")
    again.get_by_text("3 Drive data").click()
    expect(again.get_by_role("textbox", name="Gear ratios")).to_have_value("100, -90")
    expect(again.get_by_role("textbox", name="Rated torque")).to_have_value("5, 2")
    held = again.get_by_role("combobox", name="Torque between samples")
    expect(held).to_have_value("held until the next sample")
    expect(rotors(again)).to_have_value(M)
    open_study(again)
    expect(again.get_by_text("5 records")).to_be_visible()
    near_the_truth(again)
    again.goto(address, wait_until="commit")
    finished(again, "Import a log")
    expect(again.get_by_text("Still open")).to_have_count(0)
    again.close()


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


def test_by_keyboard_alone_from_a_zipped_log_to_the_report(
    log: Log, shared: Server, context: BrowserContext
) -> None:
    """Every kind of log gives K and D without a browser: ``test_import_readers.py``."""
    page = new_page(context)
    page.add_init_script("addEventListener('pointerdown', () => window.touched = true, true)")
    page.goto(shared.address, wait_until="commit")
    rested(page)
    page.bring_to_front()
    sidebar, main = (page.get_by_test_id(f"st{name}") for name in ("Sidebar", "Main"))
    tab_to(page, sidebar.get_by_role("link", name="Import a log"))
    page.keyboard.press("Enter")
    finished(page, "Import a log")
    tab_to(page, main.get_by_role("button", name="Upload", exact=True))
    packed = zipped({"keys.csv": as_csv(log, RATIOS, RATED_NM)})
    data = {"name": "keys.zip", "mimeType": "application/zip", "buffer": packed}
    with answered(page):
        with page.expect_file_chooser() as chooser:
            page.keyboard.press("Enter")
        chooser.value.set_files(data)  # type: ignore[arg-type]
    expect(page.get_by_text("6 sine runs, 6 to 26 Hz")).to_be_visible()
    texts = {"Gear ratios": RATIOS, "Rated torque": RATED_NM}
    for name, values_of in texts.items():
        type_in(page, main.get_by_role("textbox", name=name), ", ".join(f"{v:g}" for v in values_of))
    held = main.get_by_role("combobox", name="Torque between samples")
    tab_to(page, held)
    with answered(page):
        page.keyboard.type("held until")
        expect(page.get_by_role("option").first).to_have_text("held until the next sample")
        page.keyboard.press("Enter")
    expect(held).to_have_value("held until the next sample")
    press(page, main.get_by_role("button", name="Confirm the drive data"))
    for box, value in ((rotors(page), M), (main.get_by_role("textbox", name="Arm inertia M2"), M2)):
        type_in(page, box, value)
    tab_to(page, main.get_by_role("button", name="Open as study"))
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", level=1)).not_to_have_text("Import a log")
    rested(page)
    expect(page.get_by_text("6 records")).to_be_visible()
    near_the_truth(page)
    tab_to(page, sidebar.get_by_role("link", name="Report and export"))
    page.keyboard.press("Enter")
    finished(page, "Report and export")
    press(page, main.get_by_role("button", name="Make the report"))
    tab_to(page, main.get_by_role("button", name="Report as PDF"))
    with page.expect_download() as download:
        page.keyboard.press("Enter")
    assert Path(download.value.path()).read_bytes().startswith(b"%PDF")
    assert page.evaluate("window.touched") is None
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
    page.get_by_text("4 Runs").click()
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
