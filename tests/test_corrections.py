"""Corrections of a study: each removes the fault for which the verdict suggests it."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from app_pages import opened_app, upload
from plants import BAND_HZ, PAPER, SERIAL, campaign, circular, noisy, plant_phasors
from scipy.interpolate import CubicSpline

from jointid import (
    Analysis,
    Inertia,
    JointIdError,
    SineRecord,
    Study,
    analyse,
    extract_phasors,
    load_study,
    save_study,
)
from jointid.corrections.changes import corrected, label
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.exporting import to_json, to_toml
from jointid.files.digest import study_digest
from jointid.reporting.report import make_report, to_html
from jointid.ui.shared import workspace
from jointid.ui.shared.method_steps import OPEN_LOGS
from jointid.verdict import rules_skew
from jointid.verdict.evidence import Change
from jointid.verdict.rules_skew import moved_in_time, skew


@pytest.fixture(scope="module")
def right(studies: dict[int, Study]) -> Study:
    return studies[2]


def proposed(analysis: Analysis) -> list[Change]:
    return [change for finding in analysis.findings for change in finding.changes]


def each(study: Study, fault: Callable[[SineRecord], SineRecord]) -> Study:
    return replace(study, records=tuple(fault(record) for record in study.sine_records))


def flipped(j: int, *names: str) -> Callable[[SineRecord], SineRecord]:
    sign = np.where(np.arange(2) == j, -1.0, 1.0)
    return lambda record: replace(record, **{name: getattr(record, name) * sign for name in names})


def swapped(*names: str) -> Callable[[SineRecord], SineRecord]:
    return lambda record: replace(record, **{name: getattr(record, name)[:, ::-1] for name in names})


def degrees(record: SineRecord) -> SineRecord:
    return replace(record, theta_rad=record.theta_rad * np.array([180 / np.pi, 1.0]))


SIGNALS = ("theta_rad", "tau_Nm")
FAULTS = {
    "torque 1 reversed": flipped(0, "tau_Nm"),
    "angle 2 reversed": flipped(1, "theta_rad"),
    "joint 1 reversed": flipped(0, *SIGNALS),
    "torques exchanged": swapped("tau_Nm"),
    "joints exchanged": swapped(*SIGNALS),
    "angle 1 in degrees": degrees,
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_of_all_records_is_corrected(right: Study, name: str) -> None:
    wrong = each(right, FAULTS[name])
    before = analyse(wrong)
    assert before.state == "not usable"
    change = proposed(before)[0]
    mended = corrected(wrong, change)
    for a, b in zip(mended.sine_records, right.sine_records, strict=True):
        # Either sign of a joint, in angle and torque alike, is right if the coupling is.
        sign = np.sign((a.theta_rad * b.theta_rad).sum(axis=0))
        np.testing.assert_allclose(a.theta_rad, sign * b.theta_rad, rtol=1e-12)
        np.testing.assert_allclose(a.tau_Nm, sign * b.tau_Nm, rtol=1e-12)
    after = analyse(mended)
    np.testing.assert_allclose(after.fit.K, analyse(right).fit.K, rtol=1e-9)
    assert after.state == "usable"
    assert mended.changes[-1]
    assert label(wrong, change)


def late(*samples: float) -> Callable[[SineRecord], SineRecord]:
    """Joints that are logged later, by samples each."""

    def fault(record: SineRecord) -> SineRecord:
        place = np.arange(len(record.time_s), dtype=float)
        moved = {name: CubicSpline(place, getattr(record, name)) for name in SIGNALS}
        columns = {
            name: np.column_stack([wave(place - by)[:, j] for j, by in enumerate(samples)])
            for name, wave in moved.items()
        }
        return replace(record, **columns)

    return fault


@pytest.mark.parametrize("samples", [(0, 1), (2, 0)])
def test_joints_that_are_logged_apart_are_moved_together(right: Study, samples: tuple[int, ...]) -> None:
    wrong = each(right, late(*samples))
    before = analyse(wrong)
    assert before.state == "not usable"
    whose = f"joint {1 + np.argmax(samples)}"
    assert before.findings[0].title.startswith(f"Position and torque of {whose} are logged")
    change = proposed(before)[0]
    assert change.values == samples
    mended = corrected(wrong, change)
    assert whose in label(wrong, change)
    after, best = analyse(mended), analyse(right)
    assert after.state == "usable"
    np.testing.assert_allclose(after.fit.K, best.fit.K, atol=0.5 * best.fit.standard_error[0])
    assert len(mended.sine_records[0].time_s) == len(right.sine_records[0].time_s) - max(samples)


@pytest.mark.parametrize(("joints", "samples"), [(2, (0.0, 0.4)), (3, (0.0, 1.0, -0.5))])
def test_joints_may_be_logged_a_part_of_a_sample_apart(
    studies: dict[int, Study], joints: int, samples: tuple[float, ...]
) -> None:
    """Moving rows cannot correct that; the remedy is to interpolate."""
    study = each(studies[joints], late(*samples))
    found = analyse(study).findings[0]
    assert "are logged" in found.title
    assert "interpolate" in found.remedy
    assert not found.changes
    phasors = extract_phasors(study.sine_records)
    prior = InertiaPrior.of(study.inertias, *phasors.q.shape)
    apart = skew(phasors, prior, study.records[0].interval_s)
    assert apart is not None
    true = study.records[0].interval_s * np.array(samples)
    assert np.all(np.abs(apart.late_s - true) < 4 * apart.error_s + 1e-6)


@pytest.mark.parametrize(("noise", "found"), [(1.0, True), (4.0, False)])
def test_times_count_where_they_explain_the_records_within_their_noise(
    noise: float, found: bool
) -> None:
    """Far more noise than stated is a further fault, which the times do not explain."""
    late = np.array([0.0, 2e-3])
    phasors = moved_in_time(plant_phasors(SERIAL, PAPER, *campaign(BAND_HZ, 2)), -late)
    stated = np.array([np.diag((2e-3 * np.abs(z)) ** 2) for z in phasors.z]).astype(complex)
    error = circular(np.random.default_rng(1), stated, 1)[0]
    logged = noisy(phasors, stated, noise * error)
    apart = skew(logged, InertiaPrior.of(SERIAL, *logged.q.shape), 1e-3)
    assert (apart is not None) == found
    if apart is not None:
        assert abs(apart.late_s[1] - late[1]) < 4 * apart.error_s < 1e-4


@pytest.mark.parametrize(
    ("K", "misfit", "tried"), [(8.0, 2.4, False), (8.0, 2.6, True), (-1.0, 1.0, True)]
)
def test_times_are_sought_where_the_answer_does_not_explain_the_records(
    monkeypatch: pytest.MonkeyPatch, K: float, misfit: float, tried: bool
) -> None:
    asked = list[object]()
    monkeypatch.setattr(rules_skew, "skew", lambda *given: asked.append(given))
    fit = SimpleNamespace(K=np.array([43.0, K]), misfit=misfit, prior="prior")
    of_records: Any = SimpleNamespace(
        phasors=SimpleNamespace(n=2), fit=fit, has_motions=False,
        records=[SimpleNamespace(interval_s=1e-3)],
    )  # fmt: skip
    assert not list(rules_skew.joints_apart(of_records))
    assert bool(asked) == tried


def test_a_record_that_contradicts_the_others_is_corrected_or_left_out(right: Study) -> None:
    first, *others = right.sine_records
    wrong = replace(right, records=(flipped(0, "tau_Nm")(first), *others))
    scale, out = proposed(analyse(wrong))
    mended = corrected(wrong, scale).sine_records[0]
    np.testing.assert_allclose(mended.tau_Nm, first.tau_Nm, rtol=1e-9)
    assert label(wrong, out) == f"Leave out {first.label or 'record 1'}"
    assert [r.time_s.size for r in corrected(wrong, out).records] == [r.time_s.size for r in others]


def test_one_of_two_identical_records_is_left_out(right: Study) -> None:
    twice = replace(right, records=(*right.records, replace(right.sine_records[0], label="again")))
    (change,) = proposed(analyse(twice))
    assert corrected(twice, change).changes == ("Left out: again.",)
    np.testing.assert_allclose(
        analyse(corrected(twice, change)).fit.estimate, analyse(right).fit.estimate, rtol=1e-12
    )


def test_a_start_is_set_where_the_motion_has_become_steady(right: Study) -> None:
    *others, record = right.sine_records
    decay = 1 + 2 * np.exp(-(record.time_s - record.time_s[0]) * record.frequency_hz / 3)
    unsettled = replace(
        record,
        theta_rad=record.theta_rad * decay[:, None],
        tau_Nm=record.tau_Nm * decay[:, None],
        label="early.csv",
    )
    wrong = replace(right, records=(*others, unsettled))
    change = next(c for c in proposed(analyse(wrong)) if c.kind == "start")
    mended = corrected(wrong, change)
    assert "early.csv at" in mended.changes[-1]
    assert (mended.records[-1].start_s or 0) > record.time_s[0] + 1 / record.frequency_hz
    assert not any(f.title == "The motion is still settling" for f in analyse(mended).findings)


def test_a_wrong_frequency_is_replaced_by_the_measured_one(right: Study) -> None:
    first, *others = right.sine_records[:6]  # of three frequencies
    wrong = replace(right, records=(replace(first, frequency_hz=1.03 * first.frequency_hz), *others))
    change = next(c for c in proposed(analyse(wrong)) if c.kind == "frequency")
    assert corrected(wrong, change).sine_records[0].frequency_hz == pytest.approx(
        first.frequency_hz, rel=1e-3
    )


def test_a_delay_is_added_to_the_stated_one(right: Study) -> None:
    change = Change("delay", values=(0.4e-3,))
    assert "0.5 ms" in label(each(right, lambda r: replace(r, torque_delay_s=1e-4)), change)
    made = corrected(each(right, lambda r: replace(r, torque_delay_s=1e-4)), change)
    assert all(record.torque_delay_s == pytest.approx(0.5e-3) for record in made.records)
    held = corrected(right, Change("hold", values=(float(not right.records[0].torque_hold),)))
    assert all(a.torque_hold != b.torque_hold for a, b in zip(held.records, right.records, strict=True))


def test_fitted_inertias_replace_the_given_ones(right: Study) -> None:
    given = right.inertia
    wrong = replace(right, inertia=Inertia(given.M, 1.12 * given.M2), inertia_std=0.02)
    before = analyse(wrong)
    change = next(c for c in proposed(before) if c.kind == "inertias")
    made = corrected(wrong, change)
    np.testing.assert_array_equal(made.inertia.M2, before.inertia().M2)
    after = analyse(made)
    assert after.state == "usable"
    errors = before.fit.standard_error
    assert np.all(np.abs(after.fit.estimate - before.fit.estimate) < errors)
    assert np.all(after.fit.standard_error > 0.5 * errors)  # no precision is gained by accepting


def test_changes_are_kept_on_disk_and_in_the_digest(right: Study, tmp_path: Path) -> None:
    made = corrected(right, Change("leave out", (1,)))
    made = corrected(made, Change("leave out", (0,)))
    assert len(made.changes) == 2
    save_study(made, tmp_path / "made.zip")
    again = load_study(tmp_path / "made.zip")
    assert again.changes == made.changes
    assert study_digest(again) == study_digest(made) != study_digest(replace(made, changes=()))


def test_report_and_exports_list_the_changes(right: Study) -> None:
    made = analyse(corrected(right, Change("leave out", (1,))))
    (sentence,) = made.study.changes
    assert sentence in to_html(make_report(made, cut=False))
    for document in (json.loads(to_json(made)), tomllib.loads(to_toml(made))):
        assert document["obtained"]["changes"] == [sentence]


def test_an_impossible_change_is_an_error(right: Study) -> None:
    everything = tuple(range(len(right.records)))
    with pytest.raises(JointIdError, match="no records"):
        corrected(right, Change("leave out", everything))
    with pytest.raises(JointIdError, match="changes"):
        replace(right, changes="a text")  # type: ignore[arg-type]


def test_a_correction_is_applied_and_undone_on_the_page(
    right: Study, sample_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workspace, "SAMPLES", sample_folder)
    at = upload(opened_app().run(), each(right, FAULTS["torques exchanged"]))
    assert "Not usable" in at.error[0].value
    folded = next(each for each in at.expander if each.label == "If this is not the cause")
    assert "Swap the columns of these torques on import" in folded.markdown[0].value
    assert "on import" not in at.error[0].value
    way = "Import a log: 2 Columns"
    assert way not in [link.proto.label for link in at.main.get("page_link")]  # no log is open
    at.session_state[OPEN_LOGS] = ["a log"]
    at = at.run()
    assert way in [link.proto.label for link in at.main.get("page_link")]
    (fix,) = (b for b in at.button if b.label.startswith("Fix it"))
    assert fix.label == "Fix it: Swap the torques of joints 1 and 2"
    at = fix.click().run()
    table = next(t.value for t in at.table if "With the change" in t.value)
    assert list(table.iloc[0]) == ["State", "not usable", "usable"]
    assert list(table["Now"][1:-1]) == ["–"] * 4  # an unusable answer has no K and D
    assert "43.0" in table["With the change"][1]
    at = at.button(key="apply_change").click().run()
    assert not at.exception
    assert not at.error
    assert at.selectbox(key="study").value == "mine.zip, corrected"
    assert any("Swap the torques" in caption.value for caption in at.caption)
    again = opened_app()
    for name in ("w", "study"):
        value = at.query_params[name]
        again.query_params[name] = value if isinstance(value, str) else value[0]
    at = again.run()  # another session at the same address, as after a refresh
    assert at.selectbox(key="study").value == "mine.zip, corrected"
    at = at.button(key="undo_change").click().run()
    assert at.selectbox(key="study").value == "mine.zip"
    assert "mine.zip, corrected" not in at.selectbox(key="study").options
    assert "Not usable" in at.error[0].value
