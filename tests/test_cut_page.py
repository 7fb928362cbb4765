"""The page Cut without a browser: texts, figures, and data sent to the browser."""

from __future__ import annotations

import dataclasses
import re
from base64 import b64decode
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import streamlit as st
from app_pages import shown
from plants import PAPER
from streamlit.testing.v1 import AppTest
from streamlit.testing.v1.element_tree import TextInput

from jointid import Analysis, Elasticity, PlanarArm, analyse, load_study, rectangle
from jointid.cut.outcome import Outcome, cut_outcome, millimetres, study_outcome
from jointid.cut.path_deflection import PathDeflection
from jointid.cut.robot import CutRobot, assumed_elasticity, cut_robot
from jointid.figures.cut import (
    cut_over_time,
)
from jointid.figures.style import DARK, LIGHT
from jointid.files.digest import study_digest
from jointid.gears.gear import Gear
from jointid.reporting.drawing import to_svg
from jointid.reporting.figures import cut_figure
from jointid.ui.cut import cached_cuts as cut_cached
from jointid.ui.cut.pictures import (
    animated_svg,
    animation_data,
    cut_drawing,
    deflections_html,
    magnification,
    tracks,
)
from jointid.ui.cut.settings import CutSettings, usual
from jointid.ui.shared.page import Page
from jointid.ui.shared.results import ResultCache
from jointid.ui.shared.settings import DEFAULT_METHOD

PAGE = "pages/5_Cut.py"
COVARIANCE = np.diag([0.43, 0.075, 0.002, 0.0003]) ** 2


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    robot = CutRobot("direct", PlanarArm.example(), PAPER, COVARIANCE, None, None)
    return cut_outcome(robot, rectangle(), assumed_elasticity(robot, "soft"), samples=20)


def words(at: AppTest) -> str:
    kinds = (at.header, at.caption, at.info, at.markdown, at.error, at.warning)
    return " ".join(element.value for kind in kinds for element in kind)


def headline(at: AppTest) -> tuple[float, float]:
    """Path error before and after, mm."""
    text = at.header[0].value
    found = re.fullmatch(
        r"Path error (under )?([\d.]+)\smm → (under )?([\d.]+)\smm \(95th percentile\)", text
    )
    assert found, text
    return float(found[2]), float(found[4])


def meant(at: AppTest) -> tuple[float, float]:
    """Path error before and after as the sentences below the animation give it, mm."""
    found = re.findall(r"\*\*(?:Before|After), (?:under )?([\d.]+) mm\*\*", words(at))
    assert len(found) == 2, words(at)
    return float(found[0]), float(found[1])


@pytest.fixture
def another_robot(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The study's inertias are no example arm's, and that arm has other springs."""
    monkeypatch.setattr("jointid.cut.robot._matching_drive", lambda inertias: None)
    monkeypatch.setattr("jointid.cut.robot.PAPER", Elasticity([60.0, 5.0], [0.2, 0.01]))
    st.cache_resource.clear()
    yield
    st.cache_resource.clear()


def nominal(at: AppTest, name: str) -> TextInput:
    """The custom nominal K or D."""
    return next(w for w in at.text_input if w.label.startswith(f"{name}1"))


class TestPage:
    def test_of_two_joints_gives_millimetres_before_and_after(
        self, app: AppTest, sample_folder: Path
    ) -> None:
        at = shown(app.switch_page(PAGE).run())
        assert at.title[0].value == "Cut"
        before, after = headline(at)
        assert before > 1.5
        assert after < 0.1
        assert "with a parallelogram drive: its K and D apply unchanged" in words(at)
        found = analyse(load_study(sample_folder / "paper.zip")).quantities
        K, D = (", ".join(each.shown[0] for each in part) for part in (found[:2], found[2:]))
        said = f"a robot with the identified K = {K} N·m/rad, D = {D} N·m·s/rad."
        assert said in words(at)  # as on the tiles of the first screen
        assert "assumes K = 21.5, 3.75 N·m/rad" in words(at)  # what the study calls nominal
        assert not at.get("plotly_chart")  # the tabs are computed when opened
        assert [c.key for c in at.get("bidi_component")].count("cut_animation") == 1
        assert not at.error

    def test_of_nonlinear_gears_shows_the_cut_with_their_laws(
        self, app: AppTest, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        gears = Gear(backlash_rad=4e-3), Gear()
        monkeypatch.setattr(
            "jointid.ui.cut.cached_cuts.cut_robot",
            lambda *given: dataclasses.replace(cut_robot(*given), gears=gears),
        )
        own = ResultCache()  # other tests keep the cuts of the same study with linear gears
        monkeypatch.setattr("jointid.ui.shared.page.result_cache", lambda: own)
        at = shown(app.switch_page(PAGE).run())
        errors = {each.label: float(each.value.split()[-2]) for each in at.metric}
        _, after = headline(at)
        assert after == errors["Servo assumes K and D"]
        assert errors["Servo assumes K and D"] > 2 * errors["Servo assumes the gear laws"]
        assert "joint 1: backlash; joint 2: linear" in words(at)
        assert not at.exception

    @pytest.mark.parametrize("key", ["one joint", "three joints"])
    def test_a_study_without_two_joints_shows_a_demonstration(self, app: AppTest, key: str) -> None:
        app.query_params["study"] = key
        at = shown(app.switch_page(PAGE).run())
        assert "needs a study of two joints" in at.info[0].value
        assert "not this study" in at.info[0].value
        assert "Nominal" not in control(at, "cut_servo").options
        assert "mm" not in at.header[0].value
        assert "the example arm with the paper's K" in words(at)
        before, after = meant(at)
        assert before > 2 > 0.1 > after

    def test_the_first_screen_shows_the_cut_of_this_page_and_of_the_library(
        self, app: AppTest, sample_folder: Path
    ) -> None:
        """One computation serves both; its figures are those of study_outcome, to the last bit."""
        calls: list[Outcome] = []
        app.run()
        analysis = analyse(load_study(sample_folder / "paper.zip"))
        alone, study = study_outcome(analysis), analysis.study
        page = Page(
            "paper", study, study_digest(study), DEFAULT_METHOD, "N·m/rad at the motor", dark=False
        )
        assert alone is not None
        with pytest.MonkeyPatch.context() as never:
            never.setattr(cut_cached, "cut_before", lambda *_, **__: calls.append(alone))
            never.setattr(cut_cached, "predicted_cut", lambda *_, **__: calls.append(alone))
            shown_first = cut_cached.overview(page, analysis)
            settings = usual(cut_robot(analysis))
            on_its_page = cut_cached.outcome(page, settings, analysis)
        assert shown_first is not None
        assert not calls
        for one in (shown_first, on_its_page):
            assert np.array_equal(one.before.tool_m, alone.before.tool_m)
            assert np.array_equal(one.after.tool_m, alone.after.tool_m)
            assert one.spread_m == alone.spread_m

    def test_its_controls_begin_as_the_settings_of_the_first_screen(
        self, app: AppTest, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        seen: list[CutSettings] = []
        compute = cut_cached.outcome

        def noted(page: Page, settings: CutSettings, analysis: Analysis) -> Outcome:
            seen.append(settings)
            return compute(page, settings, analysis)

        monkeypatch.setattr(cut_cached, "outcome", noted)
        app.run()
        shown(app.switch_page(PAGE).run())
        assert len(seen) >= 2
        assert len(set(seen)) == 1

    def test_studies_without_nominal_values_have_other_choices(self, app: AppTest) -> None:
        app.query_params["study"] = "one joint"
        at = shown(app.switch_page(PAGE).run())
        assert control(at, "cut_servo").value == "rigid"
        at = shown(control(at, "cut_servo").set_value("stiff").run())
        at = shown(at.selectbox(key="study").set_value("paper").run())
        assert control(at, "cut_nominal").value == "study"
        assert headline(at)[0] > 1.5
        at = shown(at.selectbox(key="study").set_value("one joint").run())
        assert control(at, "cut_servo").value == "stiff"

    def test_every_nominal_controller_cuts_differently(self, app: AppTest) -> None:
        at = shown(app.switch_page(PAGE).run())
        before = {"study": headline(at)[0]}
        for name in ("rigid", "soft", "stiff"):
            before[name] = headline(shown(control(at, "cut_nominal").set_value(name).run()))[0]
        assert len(set(before.values())) == 4
        assert before["soft"] > before["rigid"] > before["stiff"] > 1

    def test_custom_values_are_used_or_refused_with_a_message(self, app: AppTest) -> None:
        at = shown(app.switch_page(PAGE).run())
        at = shown(control(at, "cut_nominal").set_value("custom").run())
        assert nominal(at, "K").value == "21.5, 3.75"
        for typed, said in (
            ("43, soft", '"soft" is not a number'),
            ("43, -7", "positive"),
            ("43", "1 value for 2 joints"),
            ("43, 7, 5", "3 values for 2 joints"),
        ):
            at = shown(nominal(at, "K").set_value(typed).run())
            assert said in at.error[0].value
            assert nominal(at, "K").value == typed
            assert at.header[0].value.startswith("Path error")  # the drawing stays
        at = shown(nominal(at, "K").set_value("43, 7.5").run())
        assert not at.error
        assert "assumes K = 43, 7.5 N·m/rad" in words(at)
        at = shown(nominal(at, "D").set_value("0.1, 0.015").run())
        assert headline(at)[0] < 0.1

    def test_k_and_d_have_the_unit_of_the_sidebar(self, app: AppTest) -> None:
        at = shown(app.switch_page(PAGE).run())
        at = shown(at.selectbox(key="unit").set_value("N·m/arcmin at the motor").run())
        K = r"0\.0125\d* ± [\d.]+, 0\.00218\d* ± [\d.]+"
        assert re.search(f"identified K = {K} N·m/arcmin, D = 0\\.(1|09)", words(at))
        assert "assumes K = 0.006254, 0.001091 N·m/arcmin" in words(at)
        before = headline(at)
        at = shown(control(at, "cut_nominal").set_value("custom").run())
        assert "(N·m/arcmin seen from the motor)" in nominal(at, "K").label
        assert nominal(at, "K").value == "0.0062541, 0.0010908"
        assert headline(at) == before  # the nominal values, in another unit

    def test_of_another_robot_custom_values_are_its_own(self, app: AppTest, another_robot: None) -> None:
        """The study's own identified values leave as much as the identification does."""
        at = shown(app.switch_page(PAGE).run())
        assert at.header[0].value.startswith("Path error of the example arm: ")
        assert "the example arm with the identified values scaled by" in words(at)
        assert "K = 60, 5 N·m/rad" in words(at)
        assert re.search(r"robot has K = 4[23]\.\d* ± [\d.]+, 7\.[45]\d* ± [\d.]+ N·m/rad", words(at))
        at = shown(control(at, "cut_nominal").set_value("custom").run())
        at = shown(nominal(at, "K").set_value("43, 7.5").run())
        at = shown(nominal(at, "D").set_value("0.1, 0.015").run())
        assert "which corresponds to K = 43, 7.5 N·m/rad" in words(at)
        before, after = meant(at)
        assert before == pytest.approx(after, abs=0.002)
        at = shown(at.switch_page("app.py").run())
        assert any("because this robot's geometry is not known" in c.value for c in at.caption)

    def test_friction_and_its_compensation_change_the_cut(self, app: AppTest) -> None:
        at = shown(app.switch_page(PAGE).run())
        ideal = headline(at)[1]
        at = shown(at.selectbox(key="cut_friction").set_value("Custom").run())
        rough = headline(at)[1]
        assert rough > ideal + 0.1
        assert "The servo does not compensate it" in words(at)
        assert "includes the effects of friction, delay and encoder" in words(at)
        assert "probability of 95 %" not in words(at)
        at = shown(at.checkbox(key="cut_compensated").check().run())
        assert headline(at)[1] < 0.2 * rough

    def test_the_tab_over_time_draws_its_figures(self, app: AppTest) -> None:
        app.query_params["cut_details"] = "Over time"
        assert len(shown(app.switch_page(PAGE).run()).get("plotly_chart")) == 1

    def test_another_drive_can_be_chosen_and_is_stated(self, app: AppTest) -> None:
        at = shown(app.switch_page(PAGE).run())
        at = shown(at.selectbox(key="cut_drive").set_value("Serial").run())
        assert "inertias are those of the other drive" in at.info[0].value

    def test_an_infeasible_path_is_refused_with_a_remedy(self, app: AppTest) -> None:
        at = shown(app.switch_page(PAGE).run())
        at = shown(at.number_input(key="cut_width").set_value(10.0).run())
        assert "does not fit" in at.error[0].value
        assert at.slider(key="cut_zone").value == 10
        at = shown(at.slider(key="cut_zone").set_value(4.0).run())
        assert not at.error
        assert "does not fit" in at.get("html")[0].proto.body  # its zone of 10 mm

    def test_the_cost_of_an_error_of_k_is_in_a_table(self, app: AppTest) -> None:
        app.query_params["cut_details"] = "Accuracy of K"
        rows = shown(app.switch_page(PAGE).run()).table[0].value
        assert list(rows.iloc[:, 0]) == ["both joints", "joint 1", "joint 2"]
        one, three, ten, thirty = (float(cell.split()[-2]) for cell in rows.iloc[0, 1:])
        assert one < three < ten < thirty < 2
        assert three == pytest.approx(3 * one, rel=0.1)  # in proportion, as long as it is small

    def test_the_assumptions_are_listed(self, app: AppTest) -> None:
        app.query_params["cut_details"] = "Assumptions"
        text = words(shown(app.switch_page(PAGE).run()))
        assert "**The paper states**" in text
        assert "**Assumed here**" in text
        assert "**Both robots are simulated.**" in text


def control(at: AppTest, key: str) -> Any:
    return next(group for group in at.get("button_group") if group.key == key)


class TestWhatTheBrowserIsSent:
    def test_tracks_are_those_of_the_runs(self, outcome: Outcome) -> None:
        table = tracks(outcome.before, outcome.after)
        assert table.dtype == np.float32
        assert table.shape[1] == 9
        time = table[:, 0].astype(float)
        assert time[0] == 0
        assert time[-1] == pytest.approx(outcome.before.time_s[-1])
        assert np.diff(time).max() <= 1.001e-3
        for first, wanted in (
            (1, outcome.before.reference_m),
            (3, outcome.before.tool_m),
            (5, outcome.after.tool_m),
        ):
            for axis in (0, 1):
                expected = np.interp(time, outcome.before.time_s, wanted[:, axis])
                np.testing.assert_allclose(table[:, first + axis], expected, atol=2e-7)
        assert table[:, 7].max() == pytest.approx(outcome.before_m, rel=1e-3)

    def test_axis_ranges_contain_the_drawn_paths(self, outcome: Outcome) -> None:
        data = animation_data(outcome, "0.4 K", dark=True)
        x, y, width, height = data["window_m"]
        for run in (outcome.before, outcome.after):
            assert np.all(run.tool_m > [x, y])
            assert np.all(run.tool_m < [x + width, y + height])
        x, y, width, height = data["cell_m"]
        assert x < 0 < x + width
        assert x + width > outcome.before.tool_m[:, 0].max()
        assert (data["nominal"], data["identified"]) == (DARK.nominal, DARK.identified)
        assert "0.4 K: 3." in data["description"]

    def test_errors_are_magnified_as_far_as_the_shape_stays_recognisable(self, outcome: Outcome) -> None:
        data = animation_data(outcome, "nominal", dark=False)
        assert data["magnifications"][:3] == [1, 2, 5]
        far, near = data["reach_m"]
        for run, reach in ((outcome.before, far), (outcome.after, near)):
            apart = np.hypot(*(run.tool_m - run.reference_m).T)
            assert reach == pytest.approx(apart.max())
        most = data["magnifications"][-1]
        assert most * near <= data["room_m"] <= 0.0084 + 1e-9
        x, y, width, height = data["window_m"]
        for run, reach in ((outcome.before, far), (outcome.after, near)):
            fits = [factor for factor in data["magnifications"] if factor * reach <= data["room_m"]]
            drawn = run.reference_m + max(fits, default=1) * (run.tool_m - run.reference_m)
            assert np.all(drawn > [x, y])
            assert np.all(drawn < [x + width, y + height])

    def test_deflections_of_six_axes_have_one_scale_and_state_it(self) -> None:
        """0.4 mm is drawn tenfold: 15 % of the shorter side are 4.2 mm."""
        path = rectangle(centre_m=(0.0, 0.0))
        reference = path.position(np.linspace(0, path.end_s, 100))
        error = np.zeros((100, 3))
        error[50] = 0.0, 0.4e-3, 0.0
        found = [
            PathDeflection(5e-4, 1e-4, 9e-4, 9e-4, f * 4e-4, 1e-7, reference, f * error, 0 * error)
            for f in (1.0, 0.5)
        ]
        assert magnification(found) == 10
        html = deflections_html(found, (0.001, 0.01), dark=False)
        assert html.count("deflection × 10: 0.40 mm → under 0.001 mm") == 1
        assert html.count("<b>0.20 mm → under 0.001 mm</b><br>zone 10 mm") == 1
        drawn = [b64decode(each).decode() for each in re.findall(r"base64,([^\"]+)", html)]
        assert len({re.search(r"viewBox=\S+ \S+ \S+ \S+", svg)[0] for svg in drawn}) == 1  # type: ignore[index]

    def test_large_errors_are_not_magnified_at_all(self) -> None:
        robot = CutRobot("direct", PlanarArm.example(), PAPER, 1e6 * COVARIANCE, None, None)
        soft = Elasticity(0.4 * PAPER.K, PAPER.D)
        outcome = cut_outcome(robot, rectangle(), soft, samples=2)
        same = dataclasses.replace(outcome, after=outcome.before)
        assert animation_data(same, "nominal", dark=False)["magnifications"] == [1]


class TestShapes:
    SQUARE = np.repeat([[0.0, 0.0], [0.01, 0.0], [0.01, 0.02], [0.0, 0.02]], 4, axis=0)

    def test_a_picture_maps_metres_to_pixels_upright(self) -> None:
        tracks = [(self.SQUARE, "#0072B2")]
        drawing = cut_drawing(self.SQUARE, tracks, [0.0, 0.0, 0.019, 0.019], "a square")
        root = ElementTree.fromstring(to_svg(drawing))
        paths = [element.attrib["d"] for element in root]
        assert len(paths) == 2
        corners = np.array(re.findall(r"([-\d.]+) ([-\d.]+)", paths[1]), float)
        np.testing.assert_allclose(corners, [[0, 190], [100, 190], [100, -10], [0, -10]], atol=0.01)

    def test_the_file_holds_every_cut_with_its_caption(self, outcome: Outcome) -> None:
        run = outcome.before
        cuts = {f"zone < {k} mm": (run, run) for k in range(3)}
        text = to_svg(cut_figure(("Nominal & co", "Identified > all"), cuts), title="A <cut>")
        root = ElementTree.fromstring(text)
        space = "{http://www.w3.org/2000/svg}"
        assert root.find(f"{space}title").text == "A <cut>"
        captions = [element.text for element in root.iter(f"{space}text")]
        error = millimetres(run.max_contour_error_m)
        assert captions.count(error) == sum("zone < " in text for text in captions) == 6
        assert "Nominal & co" in captions
        paths = list(root.iter(f"{space}path"))
        assert len(paths) == 12 + 2 + 1  # cuts over their references, a key for each row, the scale
        width, height = float(root.attrib["width"]), float(root.attrib["height"])
        for path in paths:
            xy = np.array(re.findall(r"([-\d.]+) ([-\d.]+)", path.attrib["d"]), float)
            assert np.all(xy >= 0)
            assert np.all(xy <= [width, height])
        assert "http" not in text.replace("http://www.w3.org/2000/svg", "")


class TestFigures:
    def test_the_animated_file_holds_both_cuts_and_stands_still_on_demand(
        self, outcome: Outcome
    ) -> None:
        svg = animated_svg(outcome, "0.4 K", "<cell> 1 & 2")
        drawing = ElementTree.fromstring(svg)
        assert {e.get("class") for e in drawing.iter() if e.get("class")} == {"run", "run trace"}
        assert drawing.get("aria-label", "").startswith("Cut of <cell> 1 & 2. 0.4 K: path error ")
        style = next(e.text or "" for e in drawing.iter() if e.tag.endswith("style"))
        assert "@media (prefers-reduced-motion:reduce){.run{animation:none!important}}" in style
        keys = re.findall(r"@keyframes tip1\{(.*?)100%", style)[0]
        x = np.array(re.findall(r"translate\(([-\d.]+)px", keys), float)
        run = outcome.after
        place = np.interp(np.linspace(0, run.time_s[-1], x.size), run.time_s, run.tool_m[:, 0])
        slope, offset = np.polyfit(place, x, 1)
        np.testing.assert_allclose(slope * place + offset, x, atol=0.5)  # pixels

    def test_axes_have_units_and_meanings_their_colour(self, outcome: Outcome) -> None:
        for dark, ink in ((False, LIGHT), (True, DARK)):
            figure = cut_over_time(outcome, dark=dark)
            colours = {t.name: t.line.color for t in figure.data}
            assert colours == {"nominal": ink.nominal, "identified": ink.identified}
            layout = figure.to_dict()["layout"]
            titles = [layout[name]["title"]["text"] for name in layout if "axis" in name[:5]]
            assert all("(" in title for title in titles)

    def test_errors_are_in_millimetres(self, outcome: Outcome) -> None:
        figure = cut_over_time(outcome)
        peak = max(figure.data[0].y)
        assert peak == pytest.approx(1e3 * outcome.before_m, rel=0.01)
