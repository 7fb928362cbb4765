"""The page Fleet, and the rules for outliers and drift."""

from __future__ import annotations

import datetime
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from app_pages import opened_app, shown, upload
from fleet_studies import Here, small_study
from random_cases import tries
from streamlit.testing.v1 import AppTest

from jointid import JointIdError, Study, analyse
from jointid.figures.fleet import distribution, drift_over_time
from jointid.files.digest import study_digest
from jointid.files.study_files import pack_study
from jointid.fleet import read_fleet
from jointid.fleet.row import Row, failed_row
from jointid.fleet.spread import few_values, fleet_spread, robot_drift, robust_spread, seconds
from jointid.fleet.table import read_untrusted, to_parquet
from jointid.ui.fleet import files as fleet_files
from jointid.ui.fleet import panels

PAGE = "pages/10_Fleet.py"
YEAR_S = 365.25 * 86400


def row(number: int, K: float, *, error: float = 0.1, robot: str = "A", date: str = "") -> Row:
    name = f"{number:032x}"
    return Row(
        f"/cells/{robot}/{number}.zip",
        name,
        "auto",
        "0",
        0.1,
        digest=name,
        name=f"study {number}",
        robot=robot,
        date=date,
        joints=1,
        records=3,
        K=(K,),
        D=(0.1,),
        K_error=(error,),
        D_error=(0.001,),
        model="elasticity",
        misfit=1.0,
        verdict="good",
        findings=("good: nothing to mend",),
    )


# --- numbers


def test_the_robust_spread_is_that_of_the_normal_part() -> None:
    rng = np.random.default_rng(1)
    values = 40 + 2 * rng.standard_normal(4000)
    assert robust_spread(values) == pytest.approx(2, rel=0.05)
    values[:400] = 1e6
    assert robust_spread(values) == pytest.approx(2, rel=0.2)
    assert np.isnan(robust_spread(values[:4]))


def test_an_outlier_is_far_from_the_fleet_relative_to_its_own_error() -> None:
    rng = np.random.default_rng(2)
    rows = [row(k, 40 + rng.standard_normal()) for k in range(60)]
    far, unsure = row(60, 50.0), row(61, 50.0, error=4.0)
    lost = failed_row("/x.zip", "auto", "time", "It took too long.")
    spread = fleet_spread([*rows, far, unsure, lost], "K", 1)
    assert spread.value.size == 62
    assert [spread.rows[k] for k in np.flatnonzero(spread.outliers)] == [far]
    expected = np.hypot(spread.spread, 0.1)
    assert spread.z[60] == pytest.approx((50 - spread.median) / expected)
    assert fleet_spread(rows, "K", 2).value.size == 0
    assert not fleet_spread(rows[:4], "K", 1).outliers.any()  # too few to tell


def test_an_answer_that_is_not_usable_has_no_part_in_spread_and_drift() -> None:
    dates = [f"2026-{month:02d}-01" for month in range(1, 7)]
    rows = [row(k, 43.0 + 0.1 * k, date=date) for k, date in enumerate(dates)]
    broken = replace(row(9, 680.0, error=1e12, date="2026-07-01"), verdict="problem")
    without, having = (fleet_spread(each, "K", 1) for each in (rows, [*rows, broken]))
    assert having.rows == without.rows
    assert having.median == without.median
    assert robot_drift([*rows, broken], "K", 1, "A").value.size == len(rows)


def test_a_robot_is_compared_with_itself_on_demand() -> None:
    rng = np.random.default_rng(3)
    rows = [row(k, 40 + 0.1 * rng.standard_normal(), robot="A") for k in range(20)]
    rows += [row(20 + k, 60 + 0.1 * rng.standard_normal(), robot="B") for k in range(20)]
    rows.append(row(40, 42.0, robot="A"))
    fleet = fleet_spread(rows, "K", 1)
    assert set(fleet.centre) == {fleet.median}
    own = fleet_spread(rows, "K", 1, within_robot=True)
    assert np.flatnonzero(own.outliers).tolist() == [40]
    assert own.centre[25] == pytest.approx(60, abs=0.1)


def test_equal_values_are_no_outliers() -> None:
    spread = fleet_spread([row(k, 40.0, error=0.0) for k in range(9)], "K", 1)
    assert spread.spread == 0
    assert not spread.outliers.any()


@pytest.mark.parametrize("broken", [0, 3])
def test_a_drift_is_found_with_its_error_also_among_broken_studies(broken: int) -> None:
    scores = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        rows = []
        for k in range(40):
            day = datetime.date(2024, 1, 1) + datetime.timedelta(days=int(rng.integers(0, 900)))
            years = (seconds(day.isoformat()) - seconds("2025-01-01")) / YEAR_S
            rows.append(row(k, 40 * (1 - 0.03 * years) + 0.3 * rng.standard_normal(), date=str(day)))
        rows[:broken] = [replace(r, K=(10.0,)) for r in rows[:broken]]
        drift = robot_drift(
            [*rows, row(99, 1.0, date="2024-05-05", robot="B"), row(98, 1.0)], "K", 1, "A"
        )
        assert drift.value.size == 40
        assert np.all(np.diff(drift.time_s) >= 0)
        scores.append((drift.slope_per_s * YEAR_S + 0.03 * 40) / (drift.slope_error_per_s * YEAR_S))
    assert abs(np.mean(scores)) < 0.6
    assert 0.6 < np.std(scores) < 1.5
    change, _ = drift.per_year
    assert change == pytest.approx(-0.03, abs=0.015)


@pytest.mark.parametrize("dates", [5, 8])
def test_chance_is_no_drift(dates: int) -> None:
    """The p-value of the slope is that of chance; the scatter of few values is itself uncertain."""
    rng = np.random.default_rng(3)
    p_values = []
    for _ in range(tries(300, nightly=1000)):
        values = 40 + 0.1 * rng.standard_normal(dates)
        rows = [row(k, v, date=f"{2020 + k}-01-01") for k, v in enumerate(values)]
        p_values.append(robot_drift(rows, "K", 1, "A").p_value)
    assert 0.02 < np.mean(np.array(p_values) < 0.05) < 0.08
    assert np.mean(np.array(p_values) < 0.001) <= 0.004
    rows = [
        row(k, 40 - 1.7 * k + 0.1 * rng.standard_normal(), date=f"{2020 + k}-01-01") for k in range(5)
    ]
    assert robot_drift(rows, "K", 1, "A").p_value < 1e-3


def test_few_dates_give_no_drift() -> None:
    rows = [row(k, 40.0, date=f"2026-01-0{k + 1}") for k in range(4)] + [row(9, 40.0, date="2026-01-04")]
    assert np.isnan(robot_drift(rows, "K", 1, "A").slope_per_s)
    assert robot_drift([], "K", 1, "A").value.size == 0


def test_dates_with_and_without_an_offset_are_put_in_order() -> None:
    assert seconds("2026-11-20T01:00:00+01:00") == seconds("2026-11-20")
    assert seconds("1970-01-02") == 86400


def test_the_figures_show_every_study_with_its_path() -> None:
    rng = np.random.default_rng(4)
    rows = [row(k, 40 + rng.standard_normal(), date="2026-01-01") for k in range(50)]
    spread = fleet_spread([*rows, row(50, 90.0, robot="<b>x", date="2026-01-02")], "K", 1)
    bars, out = distribution(spread).data
    assert sum(bars.y) == 50
    assert list(out.marker.symbol) == ["triangle-right"]
    assert out.name == "beyond the axis (1)"
    assert "&lt;b&gt;x" in out.text[0]
    low, high = distribution(spread).layout.xaxis.range
    assert low < spread.value[:50].min()
    assert spread.value[:50].max() < high < 90
    assert bars.marker.line.width > 0  # neighbours of one height stay apart
    times = np.array([seconds(r.date) for r in spread.rows])
    points, chosen = drift_over_time(spread, times, robot_drift(rows, "K", 1, "A")).data
    assert len(points.x) == 51
    assert points.y[50] < 90 == points.customdata[50]
    assert points.marker.symbol[50] == "triangle-up"
    assert points.name == "all robots; ▼▲ beyond the axis (1)"
    assert len(chosen.x) == 50
    # Compared with its own robot, the far study is no outlier, but it is still marked.
    within = fleet_spread(
        [*rows, *(row(60 + k, 90.0, robot="B") for k in range(5))], "K", 1, within_robot=True
    )
    assert not within.outliers.any()
    assert [trace.name for trace in distribution(within).data][1:] == ["beyond the axis (5)"]


@pytest.mark.parametrize(("count", "step"), [(3, 1), (9, 2), (24, 5), (700, 200)])
def test_studies_are_counted_in_whole_numbers(count: int, step: int) -> None:
    rows = [row(k, 40.0) for k in range(count)] + [row(count, 41.0)]
    assert distribution(fleet_spread(rows, "K", 1)).layout.yaxis.dtick == step


def test_both_spread_lines_are_inside_the_figure() -> None:
    """Values that all lie to one side of the median's spread must not push a line out."""
    values = [40.0, 40.0, 40.01, 40.4, 40.5, 40.5, 40.5, 40.5]
    figure = distribution(fleet_spread([row(k, v) for k, v in enumerate(values)], "K", 1))
    low, high = figure.layout.xaxis.range
    assert len(figure.layout.shapes) == 3
    assert all(low < shape.x0 < high for shape in figure.layout.shapes)


# --- tables of strangers


def test_a_table_is_read_in_a_process_of_its_own() -> None:
    rows = (row(1, 40.0, date="2026-01-01"), failed_row("/x.zip", "auto", "time", "…"))
    assert read_untrusted(to_parquet(rows)) == rows
    with pytest.raises(JointIdError, match="cannot be read"):
        read_untrusted(b"PAR1" + b"\x00" * 50 + b"PAR1")
    for data in (b"", pack_study(small_study(0))):
        with pytest.raises(JointIdError, match="cannot be read"):
            read_fleet(data)


@pytest.mark.parametrize("change", [{"date": "soon"}, {"verdict": "<b>"}, {"K_error": (-1.0,)}])
def test_values_that_no_batch_writes_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(JointIdError, match="was changed"):
        read_fleet(to_parquet([replace(row(1, 40.0), **change)]))


# --- the page


@pytest.fixture
def app(app: AppTest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> AppTest:
    """The page; it works in this process, which takes less time to begin than another."""
    monkeypatch.setattr(fleet_files, "read_untrusted", read_fleet)
    monkeypatch.setattr(fleet_files, "Local", Here)
    monkeypatch.setenv("JOINTID_DATA_DIR", str(tmp_path / "data"))
    return app


def drop(at: AppTest, **files: bytes) -> AppTest:
    given = [(name.replace("_", "."), data, "application/octet-stream") for name, data in files.items()]
    at.file_uploader(key="fleet_uploader").set_value(given)
    return shown(at.run())


def text_of(at: AppTest) -> str:
    parts = [*at.markdown, *at.caption, *at.info, *at.success, *at.error, *at.header]
    return "\n".join(str(part.value) for part in parts)


def fleet(count: int = 30) -> list[Row]:
    rng = np.random.default_rng(5)
    rows = [
        row(k, 40 + rng.standard_normal(), robot=f"robot {k % 2}", date=f"2026-{1 + k % 12:02d}-01")
        for k in range(count)
    ]
    return [
        *rows,
        row(count, 60.0, robot="odd"),
        failed_row("/cells/lost.zip", "auto", "time", "It took long."),
    ]


def test_an_empty_page_shows_the_first_step(app: AppTest) -> None:
    at = shown(app.switch_page(PAGE).run())
    assert "jointid batch" in at.code[0].value
    assert not at.get("plotly_chart")


def test_the_sample_studies_are_analysed_here_and_open_from_their_row(
    app: AppTest, studies: dict[int, Study]
) -> None:
    at = shown(app.switch_page(PAGE).run())
    at = shown(at.button(key="fleet_samples").click().run())
    assert "3 studies" in text_of(at)
    frame = at.dataframe[-2].value
    fit = analyse(studies[2]).fit
    paper = frame[frame["Study"] == "paper"].iloc[0]
    assert float(paper["K1"].split(" ± ")[0]) == pytest.approx(fit.K[0], rel=1e-3)
    assert {"K3", "D3"} <= set(frame.columns)
    at = shown(at.selectbox(key="fleet_study").set_value(1).run())
    at = shown(at.button(key="fleet_open_study").click().run())
    opened = next(iter(studies[n] for n in (1, 2, 3) if at.title[0].value == studies[n].name))
    assert study_digest(opened)


def test_a_table_shows_spread_drift_and_outliers(app: AppTest) -> None:
    at = drop(shown(app.switch_page(PAGE).run()), results_parquet=to_parquet(fleet()))
    said = text_of(at)
    assert "32 studies" in said
    assert "1 failed" in said
    assert "own standard error e. K in N·m/rad, D in N·m·s/rad." in said
    assert re.search(r"\*\*Stiffness K1\*\*: median ± robust spread (39|40)\.", said)
    assert len(at.get("plotly_chart")) == 4
    shown_tables = [frame.value for frame in at.dataframe]
    (robots, out, every), on_a_phone = shown_tables[::2], shown_tables[1::2]
    assert [frame.shape[1] for frame in on_a_phone] == [3, 3, 2]
    assert sorted(robots["Robot"]) == sorted({row.robot for row in fleet() if row.is_good})
    assert robots.loc[robots["Robot"] == "odd", "Outliers of K1"].item() == "1"
    assert re.match(
        r"odd is 5\d.% stiffer than the fleet; 1.outlier",
        at.header[0].value,
    )
    lost = at.table[0].value  # whose lines are not cut off
    assert out["Robot"].tolist() == ["odd"]
    assert out["Value"].tolist() == ["K1 = 60.00 ± 0.10"]
    assert lost["Why"].tolist() == ["It took long."]
    assert len(every) == 32
    at = shown(at.selectbox(key="fleet_study").set_value(30).run())
    assert "is not in this workspace" in text_of(at)  # and no path of the table is opened
    at = shown(at.selectbox(key="fleet_robot").set_value("robot 1").run())
    assert "has no drift beyond its scatter" in text_of(at)


def test_a_row_links_to_the_study_that_lies_in_the_workspace(app: AppTest) -> None:
    study = small_study(3)
    at = upload(app.run(), study)
    at.session_state["chosen"] = "paper"
    at = shown(at.switch_page(PAGE).run())
    here = replace(row(0, 40.0), digest=study_digest(study))
    at = drop(at, r_parquet=to_parquet([here]))
    at = shown(at.selectbox(key="fleet_study").set_value(0).run())
    at = shown(at.button(key="fleet_open_study").click().run())
    assert at.title[0].value == study.name
    # What is kept at the address is there in the next session.
    again = opened_app()
    value = at.query_params["w"]
    again.query_params["w"] = value if isinstance(value, str) else value[0]
    again = shown(shown(again.run()).switch_page(PAGE).run())
    assert again.dataframe[-1].value["Study"].tolist() == ["A/0.zip"]
    close = next(button for button in again.button if button.label == "Close this fleet")
    assert "jointid batch" in shown(close.click().run()).code[0].value


def test_an_unreadable_table_is_named_and_the_others_are_shown(app: AppTest) -> None:
    at = shown(app.switch_page(PAGE).run())
    at = drop(at, bad_parquet=b"PAR1", good_zip=pack_study(small_study(1)), broken_zip=b"PK")
    assert "bad.parquet: The table cannot be read" in text_of(at)
    frame = at.dataframe[-1].value
    assert frame["State"].tolist().count("— failed") == 1
    assert len(frame) == 2


def test_studies_without_a_date_show_how_to_add_one(app: AppTest) -> None:
    at = drop(
        shown(app.switch_page(PAGE).run()), r_parquet=to_parquet([row(k, 40.0 + k) for k in range(9)])
    )
    assert "date = 2026-11-20" in text_of(at)


def test_no_value_of_an_unusable_answer_is_shown() -> None:
    rows = [row(1, 43.0), replace(row(2, 4e10), verdict="problem")]
    assert panels._columns(rows)["K1"] == ["43.00 ± 0.10", "–"]


def test_few_values_give_a_deviation_with_its_limits() -> None:
    """Of 95 % of samples of three normal values, the limits hold the true deviation."""
    rng = np.random.default_rng(3)
    samples = 5.0 + 0.2 * rng.standard_normal((1500, 3))
    found = np.array([few_values(sample, np.full(3, 0.1)) for sample in samples])
    deviation, low, high, ratio = found.T
    assert np.mean((low < 0.2) & (high > 0.2)) == pytest.approx(0.95, abs=0.017)
    np.testing.assert_allclose(deviation, samples.std(axis=1, ddof=1))
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(2.0, rel=0.03)  # twice the stated errors
