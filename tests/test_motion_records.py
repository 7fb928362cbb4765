"""Records of any motion: simulated, saved, loaded, analysed and shown."""

from __future__ import annotations

import io
import tracemalloc
import zipfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_cases import examples
from streamlit.testing.v1 import AppTest

from jointid import (
    Analysis,
    Controller,
    Elasticity,
    ElasticityFit,
    Inertia,
    JointIdError,
    Measurement,
    Motion,
    MotionRecord,
    MotorFriction,
    SineRecord,
    Study,
    analyse,
    extract_phasors,
    identify_elasticity,
    identify_motion,
    load_study,
    motor_response,
    save_study,
    simulate_motion,
    simulate_records,
)
from jointid.corrections.changes import corrected
from jointid.cut.outcome import study_outcome
from jointid.estimation import motion_noise
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.exporting.identification import to_document
from jointid.exporting.matlab import to_mat
from jointid.exporting.tables import phasor_table, transfer_matrix_table
from jointid.files.digest import study_digest
from jointid.files.study_files import pack_study
from jointid.fleet.row import from_plain, row_of, to_plain
from jointid.importing import find_runs, find_segments, measure_run, study_from_logs
from jointid.importing.map.mapped_log import MappedLog
from jointid.motion.spectra import motion_phasors
from jointid.phasors.distortion import Distortion, distortion
from jointid.reporting.pdf import to_pdf
from jointid.reporting.report import make_report
from jointid.simulation.motion import KINDS
from jointid.uncertainty.answer_tables import error_table
from jointid.uncertainty.information import prior_influence
from jointid.uncertainty.motion_plan import (
    MotionLimits,
    largest_motion,
    plan_motion,
    sensor_noise,
)
from jointid.verdict.motion_findings import share_at_rest
from jointid.verdict.rules_records import sample_digests

ROOT = Path(__file__).parents[1]
ROBOT = Inertia(M=[0.0025, 0.0010], M2=[[0.004104, 0.000395], [0.000395, 0.001889]])
SPRINGS = Elasticity(K=[43.0, 7.5], D=[0.10, 0.015])
CONTROL = Controller(sample_rate_hz=500.0)


def moved(kind: str, **settings: Any) -> tuple[MotionRecord, ...]:
    shape = {"duration_s": 6.0, "from_hz": 3.0, "to_hz": 30.0} | settings
    return simulate_motion(ROBOT, SPRINGS, Motion(kind, **shape), controller=CONTROL, seed=3)


@pytest.mark.parametrize("kind", KINDS)
def test_simulated_motions_keep_their_limits_and_move_every_joint(kind: str) -> None:
    first, second = moved(kind, position_rad=0.2, velocity_rad_s=4.0, acceleration_rad_s2=150.0)
    for record in (first, second):
        velocity = np.diff(record.theta_rad, axis=0) / record.interval_s
        # The controlled joint follows its reference to a factor of about two near its bandwidth.
        assert np.all(np.abs(record.theta_rad).max(axis=0) < 0.4)
        assert np.all(np.abs(velocity).max(axis=0) < 8.0)
        assert np.all(np.std(velocity, axis=0) > 0.2)
    assert np.abs(first.theta_rad - second.theta_rad).max() > 0.05
    np.testing.assert_array_equal(
        first.tau_Nm,
        moved(kind, position_rad=0.2, velocity_rad_s=4.0, acceleration_rad_s2=150.0)[0].tau_Nm,
    )


def test_a_multisine_gives_the_transfer_matrix_of_the_robot_at_its_lines() -> None:
    """Periodic in the steady state: without noise, DFTs of one period obey H exactly."""
    records = moved("multisine")
    period = records[0].samples // 4
    Q, T = (
        np.stack([np.fft.rfft(getattr(r, name)[:period], axis=0) for r in records], axis=-1)
        for name in ("theta_rad", "tau_Nm")
    )
    again = np.fft.rfft(records[0].theta_rad[-period:], axis=0)
    np.testing.assert_allclose(again, Q[:, :, 0], atol=2e-4 * np.abs(Q).max())
    line = np.arange(5, 40)  # 3.3-26 Hz
    omega = 2 * np.pi * line / (period * records[0].interval_s)
    held = (1 - np.exp(-1j * omega / 500)) / (1j * omega / 500)  # the held torque's own transform
    H = -(omega**2)[:, None, None] * Q[line] @ np.linalg.inv(held[:, None, None] * T[line])
    expected = motor_response(omega, ROBOT, SPRINGS)
    scale = np.abs(expected).max(axis=(1, 2), keepdims=True)
    assert np.abs(H - expected).max(axis=(1, 2)).max() < 0.01 * scale.max()


def test_an_odd_multisine_leaves_even_and_some_odd_lines_empty() -> None:
    smooth = moved("multisine", odd=True)[0]
    period = smooth.samples // 4
    spectrum = np.abs(np.fft.rfft(smooth.tau_Nm[:, 0]))[::4][: period // 2]
    inside = np.arange(5, 45)
    strong = spectrum[inside] > 0.02 * spectrum[inside].max()
    assert not strong[inside % 2 == 0].any()
    assert 0.6 < strong[inside % 2 == 1].mean() < 0.9


def test_records_with_torques_of_other_scales_widen_the_errors() -> None:
    """The scale is the same in all segments of a record: that of the mean is known to its σ/√3, 1 %."""
    real = REAL | {"friction": MotorFriction(coulomb=[0.3, 0.06], step_s=1e-3)}
    motion, truth = Motion("random", 3.0, 30.0, 6.0), np.r_[SPRINGS.K, SPRINGS.D]
    records = simulate_motion(ROBOT, SPRINGS, motion, records=3, seed=4, **real)
    of_last = replace(records[2], tau_Nm=1.03 * records[2].tau_Nm)
    fit = identify_motion([*records[:2], of_last], ROBOT, inertia_std=0.05)
    share = fit.errors.K / SPRINGS.K
    assert np.all((share > 0.01) & (share < 0.02))
    assert np.all(np.abs(fit.estimate - truth) < 2 * fit.standard_error)


def test_a_record_with_a_noisy_torque_has_its_own_noise() -> None:
    """As of an aliased torque: common noise of all records would reduce the weight of the good one."""
    rng, records = np.random.default_rng(0), moved("random")
    errors = [each.tau_Nm.std(axis=0) * rng.standard_normal(each.tau_Nm.shape) for each in records]

    def fitted(*sizes: float) -> ElasticityFit:
        parts = zip(records, errors, sizes, strict=True)
        noisy = [replace(each, tau_Nm=each.tau_Nm + size * error) for each, error, size in parts]
        return identify_motion(noisy, ROBOT)

    alike, both = fitted(0.01, 0.01), fitted(0.01, 1.0)
    assert np.all(both.standard_error < 3 * alike.standard_error)
    assert np.all(np.abs(both.estimate - [*SPRINGS.K, *SPRINGS.D]) < 4 * both.standard_error)
    assert both.misfit < 1.3


def test_friction_acts_in_a_simulated_motion() -> None:
    plain = moved("random")[0]
    motion = Motion("random", duration_s=6.0, from_hz=3.0, to_hz=30.0)
    rough = simulate_motion(
        ROBOT, SPRINGS, motion, controller=CONTROL, friction=MotorFriction(coulomb=[0.4, 0.08]), seed=3
    )[0]
    velocity = np.gradient(rough.theta_rad[:, 0])
    extra = (rough.tau_Nm - plain.tau_Nm)[:, 0]
    assert np.mean(extra * velocity) > 0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"kind": "chirp"}, "expected sweep, multisine, random, moves"),
        ({"kind": "sweep", "from_hz": 9.0, "to_hz": 3.0}, "raise its upper end"),
        ({"kind": "random", "duration_s": 0.5}, "Record longer, or raise the lowest"),
    ],
)
def test_impossible_motions_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(JointIdError, match=message):
        Motion(**settings)


def table(seed: int, n: int, samples: int = 40) -> dict[str, np.ndarray]:
    source = np.random.default_rng(seed)
    time = np.cumsum(source.uniform(0.5, 1.5, samples)) * 1e-2
    return {"time_s": time} | {k: source.normal(size=(samples, n)) for k in ("theta_rad", "tau_Nm")}


@examples(30)
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(1, 3),
    sensors=st.sampled_from(["none", "first", "all"]),
    band=st.sampled_from([None, (2.5, 38.0), (0.0, 1 / 3)]),
    start=st.sampled_from([None, 0.1]),
    form=st.sampled_from(["csv", "parquet"]),
)
def test_a_study_of_sines_and_motions_is_saved_and_read_exactly(
    seed: int, n: int, sensors: str, band: tuple[float, float] | None, start: float | None, form: Any
) -> None:
    values = table(seed, n)
    arm = None
    if sensors != "none":
        arm = values["theta_rad"] / 100
        arm[:, 1 if sensors == "first" else n :] = np.nan
    motion = MotionRecord(**values, arm_rad=arm, band_hz=band, start_s=start, torque_hold=True)
    sine = SineRecord(5.0, **table(seed + 1, n))
    study = Study((motion, sine), Inertia(np.ones(n), np.eye(n)))
    assert len(study.sine_records) == len(study.motion_records) == 1
    packed = pack_study(study, record_format=form)
    again = load_study(packed)
    assert isinstance(again.records[0], MotionRecord)
    assert isinstance(again.records[1], SineRecord)
    for name in ("time_s", "theta_rad", "tau_Nm", "arm_rad", "band_hz", "start_s", "torque_hold"):
        np.testing.assert_array_equal(getattr(again.records[0], name), getattr(motion, name))
    assert pack_study(again, record_format=form) == packed
    changed = {"band_hz": (1.0, 2.0)} if band is None else {"band_hz": None}
    fields = {k: getattr(motion, k) for k in (*values, "arm_rad", "start_s", "torque_hold")}
    other = Study((MotionRecord(**fields, **changed), sine), study.inertia)
    assert len({study_digest(s) for s in (study, other)}) == 2


HEADER = "time_s,theta_m1_rad,tau_m1_Nm,theta_a1_rad"
ROWS = "\n".join(f"{k / 100},{k % 7},{k % 5},{k % 3}" for k in range(40))


def one_motion(rows: str = ROWS, header: str = HEADER, keys: str = "") -> bytes:
    toml = f'format = 1\n[inertia]\nM = [1.0]\nM2 = [[2.0]]\n[[records]]\nfile = "a.csv"\n{keys}'
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("study.toml", toml)
        archive.writestr("a.csv", f"{header}\n{rows}")
    return file.getvalue()


def test_arm_columns_are_read_into_arm_rad(tmp_path: Path) -> None:
    record = load_study(one_motion(keys="band_hz = [2, 38]")).motion_records[0]
    assert record.band_hz == (2.0, 38.0)
    assert record.arm_rad is not None
    np.testing.assert_array_equal(record.arm_rad[:, 0], np.arange(40) % 3)
    save_study(load_study(one_motion()), tmp_path / "copy")
    assert (tmp_path / "copy" / "records" / "01.csv").read_text().startswith(HEADER)


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (one_motion(ROWS.replace("0.07,0,2,1", "0.07,0,2,x")), r"a.csv, line 9, column theta_a1_rad"),
        (one_motion(header=HEADER.replace("a1", "a2")), "column theta_a2_rad, but the inertia"),
        (one_motion(keys="band_hz = [2, 60]"), r"a.csv: band_hz = \[2, 60\] Hz reaches half"),
        (one_motion(keys="band_hz = 2"), "band_hz"),
        (one_motion(keys="band_hz = [2, 9]\nfrequency_hz = 3.0"), "without frequency_hz"),
        (one_motion("\n".join(ROWS.split("\n")[:9])), "a.csv: A motion record needs at least 16"),
    ],
)
def test_faults_of_motion_records_are_named(made: bytes, message: str) -> None:
    with pytest.raises(JointIdError, match=message):
        load_study(made)


def log_of(record: MotionRecord, **changes: Any) -> MappedLog:
    fields = {name: getattr(record, name) for name in ("time_s", "theta_rad", "tau_Nm")}
    return MappedLog(**(fields | changes), torque_hold=True, name="log.csv")


REAL = {
    "controller": Controller(sample_rate_hz=500.0),
    "friction": MotorFriction(coulomb=[0.05, 0.01], step_s=1e-3),
    "measurement": Measurement(encoder_counts=65536, torque_noise_Nm=[0.02, 0.01]),
}


def test_a_record_with_gaps_everywhere_is_refused_with_its_cause() -> None:
    whole = moved("random")[0]
    kept = np.arange(whole.samples) % 80 > 0
    torn = replace(
        whole, time_s=whole.time_s[kept], theta_rad=whole.theta_rad[kept], tau_Nm=whole.tau_Nm[kept]
    )
    with pytest.raises(JointIdError, match=r"missing samples interrupt this record.* 0\.16 s, is too"):
        identify_motion([torn], ROBOT)


def test_a_band_of_too_few_lines_is_named_with_its_origin() -> None:
    time, rng = 0.004 * np.arange(500), np.random.default_rng(0)
    theta = np.sin(2 * np.pi * 0.6 * time)[:, None] + 1e-6 * rng.standard_normal((500, 1))
    record = MotionRecord(time, theta, -theta + 1e-4 * rng.standard_normal((500, 1)))
    chosen = "Hz, chosen from its spectrum, holds too few lines.*or set band_hz"
    for band, said in ((None, chosen), ((0.5, 0.8), "0.8 Hz of the study holds too few.*widen band_hz")):
        with pytest.raises(JointIdError, match=said):
            motion_phasors([replace(record, band_hz=band)], np.array([[0.0025]]))


@pytest.mark.parametrize("kind", KINDS)
def test_a_log_of_any_motion_becomes_a_motion_record_with_its_band(kind: str) -> None:
    motion = Motion(kind, 3.0, 30.0, 12.0)
    record = simulate_motion(ROBOT, SPRINGS, motion, records=1, seed=5, **REAL)[0]
    runs = find_runs(log_of(record))
    assert len(runs) == 1
    assert runs[0].is_motion
    assert runs[0].stop_s - runs[0].start_s > 10
    low, high = runs[0].band_hz or (0, 0)
    assert low < 4
    if kind != "moves":
        assert 27 < high < 40
    made = study_from_logs([log_of(record)], [runs], ROBOT).motion_records
    assert len(made) == 1
    assert made[0].torque_hold
    assert made[0].band_hz == runs[0].band_hz


@pytest.mark.parametrize("seconds", [12.0, 30.0])
def test_sweeps_do_not_become_steady_sines(seconds: float) -> None:
    record = simulate_motion(
        ROBOT, SPRINGS, Motion("sweep", 3.0, 30.0, seconds), records=1, seed=1, **REAL
    )[0]
    assert not find_segments(log_of(record))


def test_long_rests_separate_motions_and_noise_is_no_motion() -> None:
    record = simulate_motion(ROBOT, SPRINGS, Motion("random", 3.0, 30.0, 8.0), seed=2, **REAL)[0]
    count = record.samples
    noise = np.random.default_rng(0).normal(size=(2 * count, 2)) * [1e-5, 2e-2]
    theta, tau = (np.zeros((2 * count + 2500, 2)) for _ in range(2))
    for begin in (0, count + 2500):
        theta[begin : begin + count], tau[begin : begin + count] = record.theta_rad, record.tau_Nm
    theta += 1e-5 * np.random.default_rng(1).normal(size=theta.shape)
    time = np.arange(len(theta)) / 500.0
    runs = find_runs(log_of(record, time_s=time, theta_rad=theta, tau_Nm=tau))
    assert [round(run.start_s) for run in runs] == [0, 13]
    quiet = log_of(record, time_s=time[: 2 * count], theta_rad=noise[:, :1], tau_Nm=noise[:, 1:])
    found = find_runs(quiet)
    assert not found
    assert "not coherent" in found.notes[-1]


def test_a_marked_span_of_motion_is_measured_as_motion() -> None:
    record = simulate_motion(ROBOT, SPRINGS, Motion("random", 3.0, 30.0, 12.0), seed=2, **REAL)[0]
    run = measure_run(log_of(record), 2.0, 9.0)
    assert run.is_motion
    assert (run.start_s, run.stop_s) == (2.0, 9.0)
    assert measure_run(log_of(record), 2.0, 9.0, 5.0).lines_hz == (5.0,)


def motion_study(*kinds: str, sines: bool = False) -> Study:
    records: list[Any] = []
    for kind in kinds:
        motion = Motion(kind, 2.0, 35.0, 8.0)
        records += simulate_motion(ROBOT, SPRINGS, motion, records=1, seed=4, **FREE)
    if sines:
        records += simulate_records(ROBOT, SPRINGS, [5.0, 11.0, 19.0, 28.0], seed=4, **FREE)
    return Study(records, ROBOT, nominal=Elasticity(K=[20.0, 3.5], D=[0.1, 0.015]), name="cell")


FREE = {key: REAL[key] for key in ("controller", "measurement")}


def test_a_joint_that_is_logged_late_in_motions_is_named_and_moved() -> None:
    motion, fast = (
        Motion("random", 3.0, 30.0, 6.0),
        FREE | {"controller": Controller(sample_rate_hz=1000.0)},
    )
    right = simulate_motion(ROBOT, SPRINGS, motion, records=2, seed=4, **fast)
    late = [
        replace(
            record,
            theta_rad=np.column_stack([record.theta_rad[1:, 0], record.theta_rad[:-1, 1]]),
            tau_Nm=np.column_stack([record.tau_Nm[1:, 0], record.tau_Nm[:-1, 1]]),
            time_s=record.time_s[1:],
        )
        for record in right
    ]
    wrong = Study(late, ROBOT)
    (finding, *_) = analyse(wrong).findings
    assert finding.title.startswith("Position and torque of joint 2 are logged 1 ms later")
    (change,) = finding.changes
    mended = corrected(wrong, change)
    np.testing.assert_array_equal(mended.records[0].tau_Nm, right[0].tau_Nm[1:-1])
    assert analyse(mended).state == "usable"


@pytest.fixture(scope="module")
def analyses() -> dict[str, Analysis]:
    return {
        "motions": analyse(motion_study("sweep", "random")),
        "both": analyse(motion_study("random", sines=True)),
    }


@pytest.mark.parametrize("name", ["motions", "both"])
def test_a_study_with_motions_gives_the_elasticity_of_the_robot(
    analyses: dict[str, Analysis], name: str
) -> None:
    analysis = analyses[name]
    truth = np.array([43.0, 7.5, 0.10, 0.015])
    assert np.all(np.abs(analysis.fit.estimate / truth - 1) < [2e-3, 2e-3, 5e-3, 5e-3])
    assert np.all(np.abs(analysis.fit.estimate - truth) < 4 * analysis.fit.standard_error)
    assert analysis.findings[0].level == "good"
    assert analysis.state == "usable"
    assert len(analysis.fit.inertias) == len(analysis.study.records)


def test_the_transfer_matrix_of_motions_agrees_with_the_robot(analyses: dict[str, Analysis]) -> None:
    """Local polynomials do not use the model."""
    matrix = analyses["motions"].transfer_matrices[""]
    assert matrix.omega.size > 10
    off = np.abs(matrix.H - motor_response(matrix.omega, ROBOT, SPRINGS))
    assert np.median(off / matrix.standard_deviation) < 2
    diagonal = np.abs(np.einsum("fii->fi", motor_response(matrix.omega, ROBOT, SPRINGS)))
    assert np.all(np.median(np.einsum("fii->fi", off) / diagonal, axis=0) < 0.02)


@pytest.mark.parametrize("name", ["motions", "both"])
def test_a_study_with_motions_has_figures_report_and_exports(
    analyses: dict[str, Analysis], name: str
) -> None:
    analysis = analyses[name]
    assert to_document(analysis)["K"] == analysis.fit.K.tolist()
    assert to_mat(analysis).startswith(b"MATLAB 5.0")
    rows = phasor_table(analysis).strip().splitlines()
    assert len(rows) == 1 + len(analysis.study.sine_records)
    assert len(transfer_matrix_table(analysis).splitlines()) > 4
    report = make_report(analysis, cut=False)
    assert "16.0 s in all" in report.facts or "8.00 s in all" in report.facts
    assert b"%PDF" in to_pdf(report)[:8]
    assert from_plain(to_plain(row_of(analysis, study="x"))).records == len(analysis.study.records)
    assert study_outcome(analysis).after_m < study_outcome(analysis).before_m
    assert error_table(analysis.fit)
    assert prior_influence(analysis.fit).shift.shape[0] == 4


def test_linear_estimators_refuse_motions() -> None:
    with pytest.raises(JointIdError, match=r'takes sine records only.*"auto"'):
        analyse(motion_study("sweep"), method="least-squares")


def test_wrong_inertias_show_in_a_study_of_motions() -> None:
    study = motion_study("random")
    wrong = Inertia(M=1.4 * ROBOT.M, M2=ROBOT.M2)
    found = analyse(replace(study, inertia=wrong, inertia_std=0.02)).findings
    assert any(f.level in ("problem", "warning") and "inertias" in f.title for f in found)


def test_a_reversed_axis_is_named_in_a_study_of_motions() -> None:
    """The fit explains it by a coupling of the other sign."""
    study = motion_study("random")
    reversed_ = [
        replace(record, theta_rad=record.theta_rad * [1, -1], tau_Nm=record.tau_Nm * [1, -1])
        for record in study.motion_records
    ]
    found = analyse(replace(study, records=reversed_)).findings
    assert found[0].title == "Joint 1 or joint 2 looks reversed relative to the other"
    assert found[0].level == "problem"


def test_a_duplicated_motion_is_named() -> None:
    study = motion_study("random")
    (first,) = study.motion_records
    end = first.samples - 500
    part = replace(
        first,
        time_s=first.time_s[:end],
        theta_rad=first.theta_rad[:end],
        tau_Nm=first.tau_Nm[:end],
        label="copy",
    )
    found = analyse(replace(study, records=[first, part])).findings
    twice = [f for f in found if "in the study twice" in f.title]
    assert len(twice) == 1
    assert "copy" in twice[0].detail


def test_noise_in_place_of_the_torque_gives_no_usable_answer() -> None:
    """White noise replaces the torque of every record."""
    study = motion_study("random")
    record = study.motion_records[0]
    tau = np.random.default_rng(1).normal(size=record.tau_Nm.shape)
    try:
        analysis = analyse(replace(study, records=[replace(record, tau_Nm=tau)]))
    except JointIdError:
        return
    assert analysis.state != "usable"


def test_an_odd_multisine_separates_distortion_from_noise() -> None:
    """Coulomb friction is odd; noise does not change its level, which even lines show."""
    motion = Motion("multisine", 3.0, 30.0, 12.0, odd=True)

    def levels(coulomb: float, noise: float) -> Distortion:
        return distortion(
            simulate_motion(
                ROBOT,
                SPRINGS,
                motion,
                records=1,
                controller=CONTROL,
                friction=MotorFriction(coulomb=coulomb, step_s=1e-3),
                measurement=Measurement(torque_noise_Nm=noise),
                seed=7,
            )[0]
        )

    smooth, rough, loud = levels(0.0, 5e-3), levels(0.03, 5e-3), levels(0.03, 2e-2)
    assert smooth.period_s == pytest.approx(3.0)
    torque = slice(2, 4)
    assert np.all(smooth.odd[torque] < 3 * smooth.noise[torque])
    assert np.all(rough.odd[torque] > 4 * rough.noise[torque])
    assert np.all(rough.even[torque] < 2 * rough.noise[torque])
    np.testing.assert_allclose(loud.odd[torque], rough.odd[torque], rtol=0.3)
    np.testing.assert_allclose(loud.noise[torque], 4 * rough.noise[torque], rtol=0.3)


@pytest.mark.parametrize("kind", ["sweep", "random", "moves"])
def test_other_motions_have_no_level_of_distortion(kind: str) -> None:
    with pytest.raises(JointIdError, match="not a multisine"):
        distortion(moved(kind)[0])


def test_a_planned_motion_keeps_its_limits_and_predicted_errors(analyses: dict[str, Analysis]) -> None:
    analysis = analyses["motions"]
    interval = analysis.study.records[0].interval_s
    noise = sensor_noise(analysis.fit, interval)
    np.testing.assert_allclose(noise[2:], [0.02, 0.01], rtol=0.3)
    np.testing.assert_allclose(noise[:2], 2 * np.pi / 65536 / np.sqrt(12), rtol=0.3)
    limits = MotionLimits(*(np.array(x) for x in ([0.3, 0.3], [5.0, 5.0], [1.0, 0.6])))
    motion = Motion("multisine", 3.0, 30.0, 6.0, odd=True)
    plan = plan_motion(analysis.fit, ROBOT, motion, limits, interval_s=interval)
    assert plan.duration_s == pytest.approx(12.0)
    peaks = largest_motion(plan.records)
    for reached, limit in zip(
        (peaks.position_rad, peaks.velocity_rad_s, peaks.torque_Nm),
        (limits.position_rad, limits.velocity_rad_s, limits.torque_Nm),
        strict=True,
    ):
        assert np.all(reached <= limit)
    # The real experiment, with noise of its own, states about these errors.
    record = [replace(r, theta_rad=r.theta_rad.round(9), label="measured") for r in plan.records]
    stated = analyse(replace(analysis.study, records=record)).fit
    np.testing.assert_allclose(plan.alone, stated.standard_error / analysis.fit.estimate, rtol=0.5)
    today = analysis.fit.standard_error / analysis.fit.estimate
    assert np.all(plan.together < np.minimum(plan.alone, today) * 1.001)
    whole = analyse(replace(analysis.study, records=[*analysis.study.records, *record])).fit
    np.testing.assert_allclose(plan.together, whole.standard_error / whole.estimate, rtol=0.3)


def test_a_planned_motion_under_heavy_friction_keeps_its_limits() -> None:
    friction = MotorFriction(coulomb=0.1, viscous=0.05, step_s=1e-3)
    control = Controller(sample_rate_hz=1000.0)
    inertia, springs = Inertia([0.0025], [[0.004104]]), Elasticity([43.0], [0.10])
    shaking = Motion("random", 3.0, 35.0, 3.0)
    made = simulate_motion(inertia, springs, shaking, controller=control, friction=friction)
    fit = identify_motion(made, inertia)
    limits = MotionLimits(np.array([0.3]), np.array([20.0]), np.array([1.0]))
    plan = plan_motion(fit, inertia, Motion("sweep", 4.0, 30.0, 2.0), limits, interval_s=1e-3)
    assert 0.8 < largest_motion(plan.records).torque_Nm[0] <= 1.0
    real = simulate_motion(inertia, springs, plan.motion, controller=control, friction=friction)
    assert largest_motion(real).torque_Nm[0] < 1.02


def test_a_planned_motion_that_misses_a_resonance_says_so() -> None:
    """The message was that of the estimator, about columns of records that do not exist yet."""
    inertia, springs = Inertia([0.0025], [[0.004104]]), Elasticity([43.0], [0.10])
    records = simulate_records(inertia, springs, [6.0, 12.0, 20.0])
    fit = identify_elasticity(extract_phasors(records), inertia, method="weighted")
    limits = MotionLimits(np.array([0.3]), np.array([20.0]), np.array([1.0]))
    said = r"misses the resonance at 26\.\d Hz. .* raise the highest frequency \(to_hz\) to 31"
    with pytest.raises(JointIdError, match=said):
        plan_motion(fit, inertia, Motion("sweep", 2.0, 4.0, 2.0), limits, interval_s=1e-3)


@pytest.fixture
def app(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> AppTest:
    monkeypatch.setenv("JOINTID_DATA_DIR", str(tmp_path / "data"))
    at = AppTest.from_file(str(ROOT / "app.py"), default_timeout=60)
    at.query_params["study"] = "motions"
    return at


def test_every_page_shows_the_sample_of_motions(app: AppTest) -> None:
    at = app.run()
    assert not at.exception
    assert "&nbsp;·&nbsp; 2 motion records, 16.0 s in all" in " ".join(m.value for m in at.markdown)
    for page in sorted((ROOT / "pages").glob("*[1-7]_*.py")):  # 8 to 10 show no study
        at = at.switch_page(str(page)).run()
        assert not at.exception, page.name
        if page.name.startswith("1_"):
            assert [tab.label for tab in at.tabs][-1] == "Coherence"
            assert list(at.table[0].value["Band"]) == ["automatic"] * 2
        if page.name.startswith("2_"):  # no dead end
            links = [link.proto.label for link in at.main.get("page_link")]
            assert links[-2:] == ["Records", "Transfer matrix"]
        if page.name.startswith("4_"):
            assert any("Hz, chosen from its spectrum" in caption.value for caption in at.caption)
        if page.name.startswith("6_"):
            assert any(button.label == "Predict" for button in at.button)


def at_rest_for(share: float, samples: int = 4000) -> MotionRecord:
    """A motion of two joints, the first of which rests for a share of the time."""
    t = np.arange(samples) / 1000
    theta = np.stack([np.sin(20 * np.maximum(t % 1 - share, 0)), np.sin(23 * t)], axis=1)
    return MotionRecord(t, theta, np.cos(theta))


def test_the_share_of_the_time_at_rest() -> None:
    moving, resting = (share_at_rest(at_rest_for(share)) for share in (0.0, 0.6))
    assert moving.max() < 0.1
    assert resting[0] == pytest.approx(0.6, abs=0.1)
    assert resting[1] < 0.1


def test_repeated_samples_are_found_by_their_digests() -> None:
    record = at_rest_for(0.5)
    turned = replace(record, theta_rad=-record.theta_rad, tau_Nm=-record.tau_Nm)
    swapped = replace(record, theta_rad=record.theta_rad[:, ::-1])
    distinct = np.unique(np.hstack([record.theta_rad, record.tau_Nm]), axis=0)
    assert sample_digests(record).size == len(distinct)
    for other in (turned, swapped):
        assert np.intersect1d(sample_digests(record), sample_digests(other)).size < 5


def test_memory_is_linear_in_the_samples() -> None:
    rng, peaks = np.random.default_rng(0), []
    for samples in (20_000, 80_000):
        theta, tau = rng.standard_normal((2, samples, 2)).cumsum(axis=1)
        record = MotionRecord(np.arange(samples) / 1000, theta, tau, band_hz=(2.0, 30.0))
        tracemalloc.start()
        motion_phasors([record], np.ones((1, 2)))
        sample_digests(record)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 4.5 * peaks[0]


@pytest.mark.parametrize(("joints", "seconds"), [(2, 2.5), (6, 4 / 3)])
def test_wide_bands_of_many_joints_have_short_segments(joints: int, seconds: float) -> None:
    """With friction, the time of a segment grows as its cube: six axes took two minutes."""
    angle = np.cumsum(np.random.default_rng(1).standard_normal((20_000, joints)), axis=0) * 1e-3
    record = MotionRecord(np.arange(20_000) * 5e-4, angle, angle, band_hz=(3.0, 120.0))
    lengths = [
        each.duration_s for each in motion_phasors([record], np.ones((1, joints))).segments if each
    ]
    np.testing.assert_allclose(lengths, seconds, rtol=0.08)


@pytest.mark.parametrize("heavier", [1.0, 1.02])
def test_inertias_given_as_exact_are_checked_by_a_fit_with_free_ones(heavier: float) -> None:
    """The noise of motions is that of the residual: with M2 2 % wrong, K was 20 errors off unseen."""
    friction, measured = MotorFriction([0.1, 0.02]), Measurement(2**16, torque_noise_Nm=0.01)
    motion = Motion("random", 3.0, 30.0, 5.0)
    records = simulate_motion(
        ROBOT, SPRINGS, motion, controller=CONTROL, friction=friction, measurement=measured, seed=1
    )
    given = Inertia(ROBOT.M, ROBOT.M2 * [[heavier, 1.0], [1.0, 1.0]])
    fit = identify_motion(records, given, inertia_std=0.0)
    assert fit.contradicts_inertias == (heavier > 1)
    off = np.abs(fit.K - SPRINGS.K) / fit.standard_error[:2]
    assert (off.max() < 3.5) == (heavier == 1)


@pytest.mark.parametrize("heavier", [1.0, 1.001])
def test_a_small_error_of_exact_inertias_counts_by_the_stated_errors(heavier: float) -> None:
    """K was 0.08 % and 11 stated errors off, and less than 0.1 % of K did not matter."""
    motion, measured = Motion("random", 3.0, 30.0, 5.0), Measurement(2**20, torque_noise_Nm=0.003)
    records = simulate_motion(ROBOT, SPRINGS, motion, controller=CONTROL, measurement=measured, seed=1)
    given = Inertia(ROBOT.M, ROBOT.M2 * [[heavier, 1.0], [1.0, 1.0]])
    fit = identify_motion(records, given, inertia_std=0.0)
    assert fit.contradicts_inertias == (heavier > 1)


@pytest.mark.parametrize(
    ("misfit", "K", "cost", "contradicted"),
    [(1.0, 9.7, 80.0, True), (1.2, 9.7, 80.0, False), (1.0, 9.9, 80.0, False), (1.0, 9.7, 95.0, False)],
)
def test_other_inertias_count_where_they_explain_motions_with_another_K(
    monkeypatch: pytest.MonkeyPatch, misfit: float, K: float, cost: float, contradicted: bool
) -> None:
    """Beside a missing filter, right inertias looked wrong: free ones imitated a part of it."""
    free = SimpleNamespace(cost=cost, misfit=misfit, elasticity=np.array([K, 1.0]))
    monkeypatch.setattr(motion_noise, "fit_model", lambda *_, **__: free)
    prior: Any = InertiaPrior.of(Inertia([1.0], [[1.0]]), 2, 1)
    exact: Any = SimpleNamespace(cost=100.0, elasticity=np.array([10.0, 1.0]), named=None)
    unused: Any = None
    found = motion_noise.contradicts_inertias(unused, prior, exact, unused, unused, np.array([0.1, 0.1]))
    assert found == contradicted
