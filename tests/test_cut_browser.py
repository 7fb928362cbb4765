"""The animated cut in a browser: playing, pausing, scrubbing, and the settings shown."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from browsing import Watch, new_page, rested, too_wide
from playwright.sync_api import BrowserContext, Page, ViewportSize, expect

pytestmark = pytest.mark.browser

WHOLE_PAGE: ViewportSize = {"width": 1280, "height": 900}
PHONE: ViewportSize = {"width": 390, "height": 844}

Look = Callable[[Page], None]
Browse = Callable[..., None]


@pytest.fixture(scope="module")
def browse(address: str, context: BrowserContext) -> Iterator[Browse]:
    """Open a page; fail on errors and on requests to other machines."""
    windows: dict[str, Window] = {}

    def look_at(look: Look, **options: Any) -> None:
        kind = repr(options)
        if kind not in windows:
            close()  # where nobody looks, nothing is drawn
            windows[kind] = Window(new_page(context), f"{address}/Cut", **options)
        windows[kind].look(look)

    def close() -> None:
        while windows:
            windows.popitem()[1].page.close()

    yield look_at
    close()


class Window:
    """A page about the cut that stays open from test to test."""

    def __init__(self, page: Page, url: str, viewport: ViewportSize = WHOLE_PAGE, **media: Any) -> None:
        self.page, self.watch = page, Watch(page)
        page.set_viewport_size(viewport)
        page.emulate_media(**media)
        page.goto(url, wait_until="commit")
        expect(canvas(page)).to_have_attribute("data-frame", re.compile(r"\d+"))
        rested(page)

    def look(self, look: Look) -> None:
        look(self.page)
        self.watch.check()


def canvas(page: Page) -> Any:
    return page.locator("canvas.cut")


def state(page: Page) -> dict[str, str]:
    """State that the animation reports."""
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


def playing(page: Page) -> None:
    """In view and playing at true time, errors as they are, whatever an earlier test left."""
    canvas(page).scroll_into_view_if_needed()
    page.locator(".speed select").select_option("real time")
    page.get_by_role("slider", name="Magnify errors").press("Home")
    if state(page)["playing"] == "false":
        page.get_by_role("button", name="Play", exact=True).click()
    now = state(page)
    assert (now["playing"], now["speed"], now["magnification"]) == ("true", "1", "1")


def pace(page: Page) -> float:
    """Seconds of the cut per second of the clock, from frame to frame."""
    passed = canvas(page).evaluate(
        """canvas => new Promise(done => {
            const seen = [];
            const look = now => {
                seen.push([now, 1000 * Number(canvas.dataset.time)]);
                if (seen.length < 120) requestAnimationFrame(look); else done(seen);
            };
            requestAnimationFrame(look);
        })"""
    )
    steps = [(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(passed) if a[1] < b[1] < 600]
    steps = [step for step in steps if step[0] < 200]  # a busy machine drops frames
    assert len(steps) > 10
    by_clock, by_cut = map(sum, zip(*steps, strict=True))
    return float(by_cut / by_clock)


def loops(page: Page) -> float:
    """Animation callbacks per frame."""
    return float(
        page.evaluate(
            """() => new Promise(done => {
                const real = window.requestAnimationFrame.bind(window);
                let [calls, frames] = [0, 0];
                window.requestAnimationFrame = callback => { calls += 1; return real(callback); };
                const look = () => {
                    frames += 1;
                    if (frames < 40) return real(look);
                    window.requestAnimationFrame = real;
                    done(calls / frames);
                };
                real(look);
            })"""
        )
    )


def test_it_advances_at_true_time(browse: Browse) -> None:
    def look(page: Page) -> None:
        playing(page)
        assert pace(page) == pytest.approx(1, rel=0.25)
        page.locator(".speed select").select_option("1/5")
        assert pace(page) == pytest.approx(0.2, rel=0.25)

    browse(look)


def test_it_pauses_scrubs_and_steps(browse: Browse) -> None:
    def look(page: Page) -> None:
        playing(page)
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


def test_the_keys_work_independently_of_the_focus(browse: Browse) -> None:
    def look(page: Page) -> None:
        playing(page)
        button = page.locator(".cut-animation .play")
        time_slider = page.get_by_role("slider", name="Time")
        magnify = page.get_by_role("slider", name="Magnify errors")
        speed = page.locator(".speed select")
        whole = page.locator(".cut-animation")
        for control in (whole, button, time_slider, magnify, speed):
            was = state(page)["playing"]
            control.press("Space")
            expect(canvas(page)).not_to_have_attribute("data-playing", was)
        end = int(state(page)["frames"]) - 1
        for control in (whole, button, time_slider):
            control.press("Home")
            assert frame(page) == 0
            control.press("ArrowUp")
            assert frame(page) == pytest.approx(0.10 * end, abs=1)
            control.press("ArrowRight")
            assert frame(page) == pytest.approx(0.11 * end, abs=1)
            control.press("ArrowDown")
            assert frame(page) == pytest.approx(0.01 * end, abs=1)
            control.press("ArrowLeft")
            assert frame(page) == 0
            control.press("End")
            assert frame(page) == end
        magnify.press("ArrowRight")
        assert (state(page)["magnification"], frame(page)) == ("2", end)

    browse(look)


def test_the_largest_error_so_far_is_never_below_the_present_one(browse: Browse) -> None:
    def look(page: Page) -> None:
        playing(page)
        page.get_by_role("button", name="Pause", exact=True).click()
        for time_s in (0.01 + 0.0073 * step for step in range(40)):
            scrub(page, time_s)
            for name in ("nominal", "identified"):
                present, largest = (
                    float(page.locator(f".{name}-{what}").inner_text().strip("< m"))
                    for what in ("error", "largest")
                )
                assert largest >= present

    browse(look)


def test_the_magnification_keeps_the_shape_of_the_path(browse: Browse) -> None:
    def look(page: Page) -> None:
        playing(page)
        assert state(page)["factors"] == "1 1"
        slider = page.get_by_role("slider", name="Magnify errors")
        slider.press("End")
        now = state(page)
        assert int(now["magnification"]) >= 5
        nominal, identified = map(int, now["factors"].split())
        assert 1 <= nominal < identified == int(now["magnification"])
        for name, factor in (("nominal", nominal), ("identified", identified)):
            expect(page.locator(f".{name}-factor")).to_have_text(f"(error drawn × {factor})")
        slider.press("Home")
        assert state(page)["factors"] == "1 1"

    browse(look)


def test_errors_are_magnified_about_the_reference_path(browse: Browse) -> None:
    def look(page: Page) -> None:
        playing(page)
        page.get_by_role("button", name="Pause", exact=True).click()
        scrub(page, 0.25)
        near, true = point(page, "nominal"), point(page, "identified")
        slider = page.get_by_role("slider", name="Magnify errors")
        slider.focus()
        slider.press("ArrowRight")
        assert state(page)["factors"] == "2 2"
        assert state(page)["time"] == "0.2500"
        far, still = point(page, "nominal"), point(page, "identified")
        # The identified tool is within 0.1 mm of the reference, from which both move twice as far.
        for axis in (0, 1):
            assert far[axis] - true[axis] == pytest.approx(2 * (near[axis] - true[axis]), abs=0.5)
            assert still[axis] == pytest.approx(true[axis], abs=0.5)

    browse(look)


COLOURED = """canvas => {
    const {width, height} = canvas;
    const {data} = canvas.getContext("2d").getImageData(0, 0, width, height);
    const found = {nominal: [0, 0], identified: [0, 0]};
    for (let k = 0; k < data.length; k += 4) {
        const [red, , blue, alpha] = data.slice(k, k + 4);
        const warm = alpha < 200 ? 0 : red - blue;
        const name = warm > 100 ? "nominal" : warm < -100 ? "identified" : "";
        const column = (k / 4) % width;
        // but for the names at the top, on either side of the line
        if (name && k / 4 / width > 60) found[name][Number(column > 0.4 * width)] += 1;
    }
    return found;
}"""
"""Pixels of each cut left and right of 40 % of the width."""


def test_the_wipe_shows_one_cut_on_either_side(browse: Browse) -> None:
    def look(page: Page) -> None:
        playing(page)
        page.get_by_role("button", name="Pause", exact=True).click()
        scrub(page, 10.0)
        both = canvas(page).evaluate(COLOURED)
        assert all(count > 100 for sides in both.values() for count in sides)
        wipe = page.get_by_role("slider", name="Wipe")
        for _ in range(20):
            wipe.press("ArrowRight")
        assert state(page)["wipe"] == "0.4"
        halves = canvas(page).evaluate(COLOURED)
        assert halves["nominal"][1] == halves["identified"][0] == 0
        assert halves["nominal"][0] > 100 < halves["identified"][1]
        wipe.press("Home")
        assert canvas(page).evaluate(COLOURED) == both

    browse(look)


def test_another_setting_changes_the_path_and_keeps_the_time(browse: Browse) -> None:
    def look(page: Page) -> None:
        playing(page)
        page.get_by_role("button", name="Pause", exact=True).click()
        page.locator(".speed select").select_option("1/10")
        scrub(page, 0.25)
        before, picture = point(page, "nominal"), pixels(page)
        page.get_by_test_id("stMain").get_by_text("3 K", exact=True).click()
        expect(page.locator(".nominal-name")).to_have_text("3 K")
        rested(page)
        after = point(page, "nominal")
        assert abs(after[0] - before[0]) + abs(after[1] - before[1]) > 0.5
        assert pixels(page) != picture
        now = state(page)
        assert (now["time"], now["playing"], now["speed"]) == ("0.2500", "false", "0.1")
        page.get_by_role("button", name="Play", exact=True).click()
        assert pace(page) == pytest.approx(0.1, rel=0.25)
        assert loops(page) == pytest.approx(1, abs=0.3)  # the old one has ended

    browse(look)


def test_the_figure_is_saved_as_svg(browse: Browse) -> None:
    def look(page: Page) -> None:
        with page.expect_download() as download:
            page.get_by_role("button", name="Save the figure (.svg)").click()
        text = Path(download.value.path()).read_text("utf-8")
        assert text.startswith("<svg")
        assert text.count("<path") == 12 + 2 + 1  # cuts over their references, two keys, the scale
        assert page.locator("img[src^='data:image/svg+xml']").count() == 6
        sizes = page.locator("img[src^='data:image/svg+xml']").evaluate_all(
            "all => all.map(image => image.naturalWidth)"
        )
        assert all(size > 0 for size in sizes)

    browse(look)


def test_with_reduced_motion_the_finished_cut_is_shown(browse: Browse) -> None:
    def look(page: Page) -> None:
        now = state(page)
        assert now["playing"] == "false"
        assert int(now["frame"]) == int(now["frames"]) - 1
        page.get_by_role("button", name="Play", exact=True).click()
        canvas(page).scroll_into_view_if_needed()
        expect(canvas(page)).to_have_attribute("data-playing", "true")

    browse(look, reduced_motion="reduce")


def test_on_a_phone_in_either_theme(browse: Browse) -> None:
    def look(page: Page) -> None:
        assert too_wide(page) <= 0
        near, whole = canvas(page).bounding_box(), page.locator("canvas.arm").bounding_box()
        assert 300 < near["width"] <= 390
        assert whole["y"] > near["y"] + near["height"]  # one below the other
        key = page.locator(".key.identified")
        expect(key).to_have_css("border-top-color", "rgb(0, 114, 178)")
        page.emulate_media(color_scheme="dark")
        page.reload(wait_until="commit")
        expect(key).to_have_css("border-top-color", "rgb(86, 180, 233)")

    browse(look, viewport=PHONE)
