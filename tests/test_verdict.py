"""Findings: none on good data, and each fault by its name with a remedy."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plants import BAND_HZ, PAPER, PARALLELOGRAM, ROBOTS, SERIAL, campaign, rubbing, steady_records

from jointid import (
    Analysis,
    Elasticity,
    ElasticityFit,
    Finding,
    Inertia,
    MotorFriction,
    Phasors,
    SineRecord,
    Study,
    analyse,
    estimate_transfer_matrix,
    extract_phasors,
    identify_elasticity,
    load_study,
    simulate_records,
)
from jointid.estimation.estimators.parameters import ParameterLayout
from jointid.estimation.identify_elasticity import identify_each
from jointid.gears.gear import Gear
from jointid.phasors.steady_state import steady_from, unsettled
from jointid.simulation.experiment import Controller, Excitation, Measurement
from jointid.verdict.evidence import number, times_noise
from jointid.verdict.findings import Evidence
from jointid.verdict.findings import findings as all_findings
from jointid.verdict.rules_causes import against_the_paper, half_a_sample, torque_lags
from jointid.verdict.rules_effects import effects_found
from jointid.verdict.rules_inertia import axes_exchanged
from jointid.verdict.rules_model import model_limits, not_physical
from jointid.verdict.rules_outlier import one_record_off
from jointid.verdict.rules_records import loop_below_steps, stationary_joint
from jointid.verdict.scorer import Scorer
from jointid.verdict.wrong_data import wrong_data

FREQUENCIES, TORQUES = campaign(BAND_HZ, 2)
FEW, FEW_TORQUES = campaign(BAND_HZ[::2], 2)


def long(*values: Any) -> Any:
    """A case of a kind that other cases stand for in a normal run."""
    return pytest.param(*values, marks=pytest.mark.long)


def analysed(records: list[SineRecord], inertia: Inertia = SERIAL, **settings: Any) -> Analysis:
    analysis = analyse(Study(records, inertia), **settings)
    assert written_for_people(analysis.findings)
    return analysis


def findings(case: Evidence) -> tuple[Finding, ...]:
    found = all_findings(case)
    assert written_for_people(found)
    return found


def written_for_people(found: Sequence[Finding]) -> bool:
    """No computer's exponent in the texts, no plural in brackets."""
    texts = [f"{finding.title} {finding.detail} {finding.remedy}" for finding in found]
    return not any(re.search(r"\de[+-]\d|\(s\)", text) for text in texts)


def sound(**changes: Any) -> list[SineRecord]:
    settings: dict[str, Any] = {"noise": (1e-5, 3e-3), "periods": 20.37, "seed": 3}
    return steady_records(SERIAL, PAPER, FREQUENCIES, TORQUES, **{**settings, **changes})


def in_two_parts(second: Elasticity, inertia: Inertia = SERIAL, **changes: Any) -> list[SineRecord]:
    """A campaign of four frequencies, and another one of a robot with other springs or inertias."""
    common: dict[str, Any] = {"noise": (1e-5, 3e-3), "periods": 20.37}
    first = steady_records(SERIAL, PAPER, FEW, FEW_TORQUES, seed=3, **common)
    torques = changes.pop("amplitude", 1) * FEW_TORQUES
    return first + steady_records(inertia, second, FEW, torques, seed=8, **common, **changes)


def remade(record: SineRecord, **changes: Any) -> SineRecord:
    fields = ("frequency_hz", "time_s", "theta_rad", "tau_Nm")
    return SineRecord(**{**{name: getattr(record, name) for name in fields}, **changes})


def titles(analysis: Analysis) -> str:
    return " | ".join(finding.title for finding in analysis.findings)


@cache
def of_sound_data() -> Sequence[Finding]:
    """Findings about data that are right, with which those of wrong data are compared."""
    return analysed(sound(), method="weighted").findings


def unsound(analysis: Analysis) -> list[Finding]:
    return [finding for finding in analysis.findings if finding.level in ("problem", "warning")]


@pytest.mark.parametrize(
    ("periods", "seed"),
    [(3.3, 0), (3.3, 1), (8.6, 2), (20.37, 3)]
    + [long(3.3, 2), long(3.3, 3), long(8.6, 0), long(8.6, 1), long(8.6, 3)]
    + [long(20.37, seed) for seed in range(3)],
)
def test_good_data_give_no_warning(periods: float, seed: int) -> None:
    """Short records estimate their frequency inaccurately, which must not be reported."""
    analysis = analysed(sound(periods=periods, seed=seed, noise=(1e-4, 1e-2)), method="weighted")
    assert not unsound(analysis), titles(analysis)
    assert analysis.findings
    assert analysis.findings[0].level == "good"


def test_held_joints_give_no_warning() -> None:
    """Their remnants are below an encoder step; the joints move far in other records."""
    records = simulate_records(
        PARALLELOGRAM,
        PAPER,
        np.geomspace(3, 30, 8).round(2),
        excitation=Excitation(velocity_rad_s=4.0, periods=8.5, pattern="one-at-a-time"),
        measurement=Measurement(encoder_counts=1 << 16, torque_noise_Nm=0.005),
        seed=1,
    )
    analysis = analyse(Study(records, PARALLELOGRAM))
    assert not unsound(analysis), titles(analysis)


def test_data_without_noise_give_no_warning() -> None:
    analysis = analysed(sound(noise=(0.0, 0.0)), method="weighted")
    assert not unsound(analysis), titles(analysis)


def test_friction_in_records_without_noise_gives_no_warning() -> None:
    """Its waveforms leave some 10⁻⁵ of the torque: far above such noise, and of no consequence."""
    friction = MotorFriction(coulomb=[0.03, 0.01], viscous=[2e-3, 5e-4])
    length = Excitation(duration_s=1.0)
    records = simulate_records(
        SERIAL, PAPER, np.geomspace(4, 25, 4), friction=friction, excitation=length
    )
    found = analyse(Study(records, SERIAL))
    assert np.abs(found.fit.K / PAPER.K - 1).max() < 1e-5
    assert found.state == "usable", titles(found)


def test_large_misfit_of_much_of_the_torque_is_a_problem() -> None:
    quiet = sound(noise=(1e-6, 1e-4))
    (limits,) = model_limits(evidence(quiet, Inertia(SERIAL.M, 1.3 * SERIAL.M2)))
    assert limits.level == "problem"
    assert limits.code == "model limits"
    assert "of the torque" in limits.detail
    assert times_noise(4e6) == "over 1000 × noise"


def test_a_linear_fit_in_place_of_a_failed_search_may_contradict_the_data() -> None:
    """With sticking motors it was 54,000 × noise off, K1 86 %, and "usable with care"."""
    case = evidence(sound(noise=(1e-6, 1e-4)), Inertia(SERIAL.M, 1.3 * SERIAL.M2))
    by_user = replace(case.fit, method="weighted", candidates=())
    instead = replace(case.fit, method="weighted")
    assert instead.candidates
    levels = [next(model_limits(replace(case, fit=fit))).level for fit in (by_user, instead)]
    assert levels == ["warning", "problem"]


def test_record_with_most_of_the_misfit_is_named() -> None:
    records = sound()
    records[9] = remade(records[9], label="other.csv")
    case = evidence(records, SERIAL)
    residual = case.fit.residual_noise + 0j
    residual[9] *= 20
    fit = replace(case.fit, residual=residual, cost=10 * case.fit.expected_cost)
    (limits,) = model_limits(replace(case, fit=fit))
    assert limits.level == "warning"
    assert 'Most of it is in "other.csv": 20 × noise; in the others up to 1.0 × noise.' in limits.detail
    assert [(each.kind, each.records) for each in limits.changes] == [("leave out", (9,))]


@pytest.mark.parametrize("inertia_std", [0.0, 0.05])
def test_a_torque_scale_far_from_the_stated_one_is_reported(inertia_std: float) -> None:
    records = [remade(record, tau_Nm=record.tau_Nm * [0.75, 1.0]) for record in sound()]
    found = analyse(Study(records, SERIAL, inertia_std=inertia_std, torque_std=0.05))
    (wrong,) = said(found.findings, "torque scales or inertias look wrong")
    assert wrong.level == "warning"
    assert wrong.detail.startswith("Torque scale 1 was entered as 1 ± 0.050; the records indicate 1.")


def test_every_finding_has_a_figure_and_a_remedy() -> None:
    records = sound()
    records[3] = remade(records[3], frequency_hz=records[3].frequency_hz * 1.01)
    wrong = analysed(records, Inertia(M=SERIAL.M, M2=SERIAL.M2 * 1.2))
    assert unsound(wrong)
    for finding in unsound(wrong):
        assert finding.title[0].isupper() or finding.title[0].isdigit()
        assert any(letter.isdigit() for letter in finding.detail)
        assert finding.remedy
        assert finding.action or "on import" not in finding.remedy
    weights = [finding.weight for finding in wrong.findings]
    assert weights == sorted(weights, reverse=True)


@pytest.mark.parametrize(("factor", "level"), [(1.005, "warning"), (2.0, "problem"), (0.5, "problem")])
def test_wrong_frequency_is_found_and_the_record_named(factor: float, level: str) -> None:
    records = sound()
    records[4] = remade(records[4], frequency_hz=records[4].frequency_hz * factor, label="five.csv")
    found = [f for f in analysed(records, method="weighted").findings if "frequency" in f.title]
    assert len(found) == 1
    assert found[0].level == level
    assert "five.csv" in found[0].detail
    assert "frequency_hz" in found[0].remedy


def test_transient_is_found_and_the_record_named() -> None:
    records = sound()
    time = records[6].time_s
    theta = records[6].theta_rad
    swing = 0.3 * np.abs(theta).max() * np.exp(-time / 0.2) * np.sin(2 * np.pi * 9.5 * time)
    records[6] = remade(records[6], theta_rad=theta + swing[:, None], label="seven.csv")
    found = [f for f in analysed(records, method="weighted").findings if "settling" in f.title]
    assert len(found) == 1
    assert "seven.csv" in found[0].detail
    assert "start_s" in found[0].remedy
    assert found[0].action == "edit runs"


def test_the_proposed_start_removes_the_transient() -> None:
    """Begun there, the record raises no alarm, and its phasor comes near the one without transient."""
    records, begin = sound(), 100.0
    true = extract_phasors([remade(records[k], time_s=records[k].time_s + begin) for k in (6, 11)])
    for k in (6, 11):
        time = records[k].time_s + begin
        theta = records[k].theta_rad
        swing = 0.3 * np.abs(theta).max() * np.exp(-(time - begin) / 0.15) * np.sin(60.0 * time)
        records[k] = remade(records[k], time_s=time, theta_rad=theta + swing[:, None], label=f"{k}.csv")
    told = analysed(records, method="weighted")
    (finding,) = (f for f in told.findings if "settling" in f.title)
    starts = dict(re.findall(r'"(\d+\.csv)", from ([\d.]+) s on', finding.detail))
    assert starts.keys() == {"6.csv", "11.csv"}
    assert "Start the records at these times" in finding.remedy
    for k in (6, 11):
        start = float(starts[f"{k}.csv"])
        assert begin + 0.15 < start < records[k].time_s.mean()
        records[k] = replace(records[k], start_s=start)
    mended = analysed(records, method="weighted")
    assert "settling" not in titles(mended)
    off = [np.abs(a.phasors.z[[6, 11]] / true.z - 1).max(axis=1) for a in (told, mended)]
    assert np.all(off[1] < 0.2 * off[0])


def test_no_start_is_proposed_where_a_motion_never_settles() -> None:
    records = sound()
    time, theta = records[6].time_s, records[6].theta_rad
    growing = theta * (1 + 0.5 * (time - time[0]) / np.ptp(time))[:, None]
    records[6] = remade(records[6], theta_rad=growing, label="seven.csv")
    assert steady_from(records[6]) is None
    (finding,) = (f for f in analysed(records, method="weighted").findings if "settling" in f.title)
    assert '"seven.csv" does not become steady' in finding.detail
    assert finding.remedy.startswith("Measure again.")


def test_a_steady_record_may_begin_after_a_period() -> None:
    for record in sound():
        start = steady_from(record)
        assert start is not None
        assert (start - record.time_s[0]) * record.frequency_hz < 4  # by chance not at once


def test_all_records_that_settle_are_named_up_to_three() -> None:
    records = sound()
    for k in range(5):
        time, theta = records[k].time_s, records[k].theta_rad
        swing = 0.3 * np.abs(theta).max() * np.exp(-time / 0.2) * np.sin(2 * np.pi * 9.5 * time)
        records[k] = remade(records[k], theta_rad=theta + swing[:, None], label=f"r{k}.csv")
        if k in (1, 4):
            found = [f for f in analysed(records).findings if "settling" in f.title]
            assert sum(f"r{i}.csv" in found[0].detail for i in range(5)) == min(k + 1, 3)
            assert ("and 2 more" in found[0].detail) == (k == 4)


def test_unstated_delay_is_found() -> None:
    for records in (sound(delay_s=0.004, told=False), six(delay_s=0.004, told=False)):
        analysis = analysed(records, method="weighted")
        assert any("delay" in (f.remedy + f.title + f.detail).lower() for f in unsound(analysis))
        assert not said(analysis.findings, "record")  # accuses none


def test_frequency_without_transfer_matrix_is_mentioned() -> None:
    analysis = analysed(sound()[:-1], method="weighted")
    found = [f for f in analysis.findings if "transfer matrix" in f.title]
    assert len(found) == 1
    assert "28.9 Hz" in found[0].detail


# ---------------------------------------------------------------------- units, signs and gear ratios


def scaled(angle: Any = 1.0, torque: Any = 1.0) -> list[SineRecord]:
    return [
        remade(r, theta_rad=r.theta_rad * np.asarray(angle), tau_Nm=r.tau_Nm * np.asarray(torque))
        for r in sound()
    ]


def scales(records: list[SineRecord], inertia: Inertia = SERIAL) -> Finding | None:
    """What is said of scales, without an estimate having to be possible."""
    found = wrong_data(extract_phasors(records), [inertia] * len(records))
    assert len(found) < 2
    return found[0] if found else None


def test_wrong_inertias_or_friction_give_no_finding_about_scales() -> None:
    assert scales(sound(), Inertia(SERIAL.M, SERIAL.M2 * 1.1)) is None
    assert scales(list(rubbing()), PARALLELOGRAM) is None


@pytest.mark.parametrize(
    ("angle", "torque", "title", "method"),
    [
        (1.0, -1.0, "sign of the torque", "auto"),
        long(180 / np.pi, 1.0, "seems to be in degrees", "weighted"),
        (1.0, -1.0, "sign of the torque", "weighted"),
        long(1.0, -1.0, "sign of the torque", "least-squares"),
    ],
)
def test_a_wrong_scale_comes_first_and_suppresses_its_consequences(
    angle: float, torque: float, title: str, method: str
) -> None:
    analysis = analysed(scaled(angle, torque), method=method)
    assert title in analysis.findings[0].title
    assert analysis.findings[0].level == "problem"
    assert len(unsound(analysis)) == 1
    assert not said(analysis.findings, "record")  # accuses none


@pytest.mark.parametrize(("unit", "size"), [("rad/s", 1.0), ("rpm", np.pi / 30)])
def test_velocities_in_place_of_positions_are_named(unit: str, size: float) -> None:
    records = [remade(r, theta_rad=np.gradient(r.theta_rad, r.time_s, axis=0) / size) for r in sound()]
    analysis = analysed(records)
    assert analysis.headline == "Not usable: The positions seem to be velocities."
    assert f"velocities in {unit}, they give K of about" in analysis.findings[0].detail
    assert not any(
        set(each.parts) - {"friction", "viscous", "delay"} for each in analysis.fit.candidates
    )


# --------------------------------------------------------------------------- friction, delay, estimator


def evidence(
    records: Sequence[SineRecord],
    inertia: Inertia,
    *,
    poses: dict[str, Inertia] | None = None,
    **model: Any,
) -> Evidence:
    """An analysis with a model of one's own choice: rules must not depend on how it was chosen."""
    study = Study(records, inertia, poses=poses or {})
    phasors = extract_phasors(study.records)
    inertias = study.inertias
    pose_of = np.array([r.pose or "" for r in records])
    return Evidence(
        records=study.records,
        inertias=inertias,
        phasors=phasors,
        fit=identify_elasticity(phasors, inertias, **{"method": "maximum-likelihood", **model}),
        transfer_matrices={
            str(pose): estimate_transfer_matrix(phasors.select(pose_of == pose))
            for pose in np.unique(pose_of)
        },
    )


@cache
def of_rubbing(**model: Any) -> Evidence:
    return evidence(rubbing(), PARALLELOGRAM, **model)


def said(found: Sequence[Finding] | Iterator[Finding], words: str) -> list[Finding]:
    return [finding for finding in found if words in finding.title]


def by_the_paper(case: Evidence) -> ElasticityFit:
    return identify_elasticity(case.phasors, case.inertias, method="least-squares")


def test_wrong_inertias_are_not_attributed_to_friction() -> None:
    """The fit corrects M2 and finds friction; the note states the share of the friction only."""
    wrong = Inertia(PARALLELOGRAM.M, 1.05 * PARALLELOGRAM.M2)
    shares = [
        said(against_the_paper(evidence(rubbing(), given, friction=True, inertia_std=0.1)), "Friction")
        for given in (PARALLELOGRAM, wrong)
    ]
    right, other = (found.weight for (found,) in shares)
    assert other == pytest.approx(right, rel=0.1)


def test_viscous_friction_alone_is_named_in_the_unit_of_its_coefficient() -> None:
    records = simulate_records(
        PARALLELOGRAM,
        PAPER,
        np.geomspace(3, 30, 6).round(2),
        friction=MotorFriction(viscous=[0.02, 0.004]),
        excitation=Excitation(duration_s=2.0),
        measurement=Measurement(torque_noise_Nm=0.005),
        seed=1,
    )
    analysis = analyse(Study(records, PARALLELOGRAM))
    (friction,) = said(analysis.findings, "Friction matters")
    assert "Viscous friction is 0.02 and 0.004 N·m·s/rad; the fit includes it." in friction.detail
    assert not unsound(analysis)


def test_friction_finding_states_the_difference_to_the_paper_method() -> None:
    case = of_rubbing(friction=True)
    found = findings(case)
    (friction,) = said(found, "Friction matters")
    assert friction.level == "note"
    share = np.abs(by_the_paper(case).estimate / np.r_[PAPER.K, PAPER.D] - 1).max()
    assert friction.weight == pytest.approx(share, rel=0.02)
    assert f"{100 * share:.0f} % too high" in friction.title
    assert "0.1 and 0.02 N·m" in friction.detail
    assert "rad" not in friction.detail  # K and D have the unit of the answer, which a finding lacks
    assert found[0].level == "good"


def test_ignored_friction_is_a_warning() -> None:
    found = findings(of_rubbing(method="weighted"))
    (limits,) = said(found, "model, not the noise")
    assert "odd harmonics" in limits.remedy
    assert "estimator auto" in limits.remedy
    assert not said(found, "record")
    assert not said(found, "inertias")


@pytest.mark.parametrize(
    ("K2", "D2_errors", "title"),
    [(-7.5, 9.0, "K2 is negative"), (7.5, -2.5, "D2 is negative"), (7.5, -1.5, None)],
)
def test_negative_springs_and_dampers_are_named(K2: float, D2_errors: float, title: str | None) -> None:
    """A damper only where noise does not explain it."""
    case = evidence(sound(), SERIAL, method="weighted")
    D2 = D2_errors * case.fit.standard_error[3]
    fit = replace(case.fit, K=np.array([43.0, K2]), D=np.array([0.1, D2]))
    found = list(not_physical(replace(case, fit=fit)))
    assert [f.title for f in found] == ([title] if title else [])
    assert all(f.level == ("problem" if K2 < 0 else "warning") for f in found)


def test_without_friction_there_is_no_finding_about_it() -> None:
    case = evidence(sound(), SERIAL)
    assert not said(findings(case), "riction")
    assert not said(findings(case), "paper")


def test_noise_that_biases_least_squares_is_reported() -> None:
    case = evidence(sound(noise=(5e-3, 0.1)), SERIAL)
    rule = list(against_the_paper(case))
    paper = by_the_paper(case)
    off = np.abs(paper.estimate - case.fit.estimate)
    clear = off > 4 * np.hypot(case.fit.standard_error, paper.standard_error)
    assert bool(rule) == bool(clear.any())
    assert not list(against_the_paper(evidence(sound(), SERIAL, method="least-squares")))


@pytest.mark.parametrize(
    ("delay_s", "verb"),
    [(0.0015, "lags by 1.5 ms"), (-0.0004, "leads by 0.4 ms"), (5.4e-5, "lags by 0.05")],
)
def test_lag_of_the_torque_is_reported(delay_s: float, verb: str) -> None:
    case = evidence(sound(delay_s=delay_s, told=False), SERIAL, delay=True)
    (lag,) = said(findings(case), verb)
    assert lag.level == "note"
    assert "too" in lag.detail
    assert "torque_delay_s" in lag.remedy
    (change,) = lag.changes
    step, to = ("add", "to") if delay_s > 0 else ("subtract", "from")
    assert f"{step} {1e3 * abs(change.values[0]):.6g} ms {to} the torque's delay" in lag.remedy
    assert not said(findings(evidence(sound(), SERIAL, delay=True)), "The torque")


def test_lag_of_a_hold_is_recognised() -> None:
    case = evidence(sound(hold=True, told=False), SERIAL, delay=True)
    (lag,) = said(findings(case), "The torque lags by")
    size_ms = float(lag.title.split()[4])
    assert size_ms == pytest.approx(0.5, abs=5e-4)
    assert "torque_hold = true" in lag.remedy


def test_a_joint_at_rest_is_named() -> None:
    records = rubbing((0.4, 0.08), "one-at-a-time", 2.5e-4, every=1)
    case = evidence(records, PARALLELOGRAM, friction=True)
    standing, sticking = stationary_joint(case)
    assert standing.title.startswith("Joint 1 hardly moves")
    assert "7 of 14 records" in standing.title
    assert sticking.title == "Joint 2 hardly moves in 2 of 14 records"  # at the low frequencies
    assert not list(stationary_joint(of_rubbing(friction=True)))


# --------------------------------------------------------------------------------- inertias, poses, gear


@pytest.mark.parametrize("factor", [0.97, long(1.03)])
def test_wrong_inertias_are_reported_with_the_right_ones(factor: float) -> None:
    found = findings(evidence(sound(), Inertia(SERIAL.M, SERIAL.M2 * factor)))
    (wrong,) = said(found, "inertias look wrong")
    assert wrong.level == "warning"
    told = re.search(r"the records indicate ([\d.]+) ± ([\d.]+) kg·m²", wrong.detail)
    assert told is not None
    value, error = float(told[1]), float(told[2])
    assert min(abs(value - truth) for truth in (0.006345, 0.002095, 0.001889)) < 4 * error < 0.01 * value
    assert not said(found, "model, not the noise")  # the cause is known


def test_exact_inertias_that_contradict_the_records_make_the_answer_unusable() -> None:
    """With inertias 30 % off, K and D are tens of per cent off, whatever their stated errors."""
    found = findings(evidence(sound(), Inertia(SERIAL.M, SERIAL.M2 * [[1.3, 1], [1, 1]])))
    (wrong,) = said(found, "inertias look wrong")
    assert wrong.level == "problem"


def test_wrong_inertias_are_found_beside_friction() -> None:
    given = Inertia(PARALLELOGRAM.M, PARALLELOGRAM.M2 * 1.03)
    found = findings(evidence(rubbing(), given, friction=True))
    assert len(said(found, "inertias look wrong")) == 1


@pytest.mark.parametrize(("truth", "given"), [(SERIAL, PARALLELOGRAM), long(PARALLELOGRAM, SERIAL)])
def test_inertias_of_another_drive_are_a_finding(truth: Inertia, given: Inertia) -> None:
    records = steady_records(truth, PAPER, FREQUENCIES, TORQUES, noise=(1e-5, 3e-3))
    assert said(findings(evidence(records, given, method="weighted")), "inertias look wrong")


def test_right_inertias_give_no_finding() -> None:
    for case in (
        evidence(sound(), SERIAL),
        of_rubbing(friction=True),
        evidence(sound(delay_s=0.0015, told=False), SERIAL, method="weighted"),
    ):
        assert not said(findings(case), "inertias")


def test_poses_that_disagree_are_a_finding() -> None:
    stiffer = Elasticity(K=[43.0, 7.8], D=PAPER.D)
    there = {"poses": {"there": PARALLELOGRAM}, "method": "weighted"}
    apart, same = (in_two_parts(k, PARALLELOGRAM, pose="there") for k in (stiffer, PAPER))
    found = findings(evidence(apart, SERIAL, **there))
    assert not said(found, "record")
    (disagree,) = said(found, "poses disagree on K2")
    assert "there" in disagree.detail
    assert disagree.weight == pytest.approx(10 + 0.3 / 7.65, abs=0.005)
    assert not said(findings(evidence(same, SERIAL, **there)), "poses")


@pytest.mark.parametrize("harder", [0.03, 0.0])
def test_a_hardening_gear_is_a_finding(harder: float) -> None:
    stiffer = Elasticity(K=[43.0 * (1 + harder), 7.5], D=PAPER.D)
    records = in_two_parts(stiffer, amplitude=3)
    found = said(findings(evidence(records, SERIAL, method="weighted")), "rises with the deflection")
    assert len(found) == (harder > 0)


@pytest.mark.parametrize(
    ("band", "coulomb"), [(BAND_HZ[:3], [0.1, 0.02]), long(BAND_HZ[4:], [0.03, 0.006])]
)
def test_ignored_friction_is_not_attributed_to_other_causes(
    band: np.ndarray, coulomb: list[float]
) -> None:
    """With few frequencies it resembles a hardening gear or other inertias."""
    records = [
        record
        for speed in (2.0, 8.0)
        for record in simulate_records(
            PARALLELOGRAM,
            PAPER,
            band,
            friction=MotorFriction(coulomb=coulomb, step_s=5e-4),
            controller=Controller(sample_rate_hz=2000),
            excitation=Excitation(duration_s=1.5, velocity_rad_s=speed, acceleration_rad_s2=1e4),
            measurement=Measurement(position_noise_rad=1e-5, torque_noise_Nm=3e-3),
        )
    ]
    found = findings(evidence(records, PARALLELOGRAM, method="weighted"))
    assert not said(found, "with the deflection")
    assert not said(found, "inertias")
    (limits,) = said(found, "model, not the noise")
    assert "odd harmonics" in limits.remedy


# ------------------------------------------------------------------------------------------ the records


def test_a_duplicated_record_is_named() -> None:
    records = sound()
    twice = [*records, remade(records[2], label="copy.csv")]
    (double,) = said(analysed(twice, method="weighted").findings, "in the study twice")
    assert '"record 3" and "copy.csv"' in double.detail
    again = [*records, *sound(seed=77)[2:3]]  # a repetition is no copy
    assert not said(analysed(again, method="weighted").findings, "twice")


def test_two_records_of_one_experiment_are_named() -> None:
    records = sound()
    other = sound(seed=5)
    records[-1] = remade(other[-2], theta_rad=1.3 * other[-2].theta_rad, tau_Nm=1.3 * other[-2].tau_Nm)
    found = analysed(records, method="weighted").findings
    (same,) = said(found, "1 frequency has no transfer matrix")
    assert same.detail.startswith('At 28.9 Hz the torques of "record 13", "record 14"')
    assert "as in repeated experiments. Measure a record with different" in same.detail
    assert not said(of_sound_data(), "transfer matrix")


@pytest.mark.parametrize(("periods", "told"), [(2.2, True), (5.0, False)])
def test_few_periods_are_reported(periods: float, told: bool) -> None:
    found = analysed(sound(periods=periods), method="weighted").findings
    assert bool(said(found, "few periods")) == told


def test_frequencies_far_from_the_resonances_are_reported() -> None:
    low = steady_records(
        SERIAL, PAPER, *campaign([1.0, 1.5, 2.0, 2.7, 3.5], 2), noise=(1e-4, 1e-2), seed=1
    )
    (missed,) = said(analysed(low, method="weighted").findings, "The frequencies miss")
    assert "1 to 3.5 Hz" in missed.detail
    assert "8.8" in missed.remedy
    assert not said(of_sound_data(), "resonance")


@pytest.mark.parametrize(("count", "level"), [(1, "problem"), (2, "warning")])
def test_a_single_frequency_is_reported_and_a_useful_one_suggested(count: int, level: str) -> None:
    found = analysed(sound()[:count], method="weighted").findings
    (alone,) = said(found, "at one frequency cannot confirm K and D")
    assert alone.level == level
    assert f"{count} record" in alone.detail
    assert not any(
        re.search(r"×10⁻|span 3.1 to 3.1", f.detail + f.remedy) for f in said(found, "resonance")
    )


def test_a_large_standard_error_is_a_warning() -> None:
    torques = 0.2 * TORQUES
    wild = steady_records(SERIAL, PAPER, FREQUENCIES, torques, noise=(0.02, 0.4), periods=9.3)
    (vague,) = said(analysed(wild, method="weighted").findings, "poorly determined")
    assert vague.level == "warning"
    assert not said(of_sound_data(), "poorly determined")


def test_noise_does_not_contradict_the_frequency() -> None:
    loud = analysed(sound(noise=(0.05, 3.0), periods=6.3), method="weighted")
    assert not said(loud.findings, "frequency")


@pytest.mark.parametrize(("presliding_rad", "levels"), [(5e-3, ["warning"]), (1e-2, [])])
def test_hysteresis_below_the_steps_of_the_encoder_is_named(
    presliding_rad: float, levels: list[str]
) -> None:
    turn = 2 * np.pi * 3 * np.arange(2000) / 1000
    angle = 1e-3 * np.rint(20 * np.sin(turn))
    record = SineRecord(
        frequency_hz=3.0,
        time_s=turn / (6 * np.pi),
        theta_rad=angle[:, None],
        tau_Nm=np.cos(turn)[:, None],
    )
    gear = Gear(K=10.0, hysteresis_Nm=0.1, presliding_rad=presliding_rad)
    evidence = SimpleNamespace(sines=[record], fit=SimpleNamespace(gears=(gear,)))
    found = list(loop_below_steps(evidence))  # type: ignore[arg-type]
    assert [finding.level for finding in found] == levels
    assert [finding.weight for finding in found] == [10.03] * len(levels)


@pytest.mark.parametrize("counts", [4096, 2**22])
def test_coarse_encoder_is_reported(counts: int) -> None:
    step = 2 * np.pi / counts
    records = [remade(r, theta_rad=np.rint(r.theta_rad / step) * step) for r in sound()]
    found = said(analysed(records, method="weighted").findings, "encoder of joint")
    assert bool(found) == (counts == 4096)
    for finding in found:
        assert "4,096 counts per turn" in finding.detail


def test_rounding_of_the_smallest_motions_is_a_note() -> None:
    """The errors include it: of 40 studies with 2¹¹ to 2¹⁵ counts, none was beyond 2.3 errors."""
    step = 2 * np.pi / 600
    records = [remade(r, theta_rad=np.rint(r.theta_rad / step) * step) for r in sound()]
    analysis = analysed(records, method="weighted")
    steps = np.abs(analysis.phasors.q) / step
    assert np.all(steps.min(axis=0) < 3)
    levels = {finding.level for finding in said(analysis.findings, "encoder of joint")}
    assert levels == {"note"}


def test_repeated_rounding_is_not_reported_as_settling() -> None:
    """A change that is as large as the rounding of either part says nothing, without other noise."""
    phasors = extract_phasors(sound())
    shape = phasors.settling.shape
    still, moving = np.full(shape, 1e-12), np.full(shape, 0.02)
    exact = replace(phasors, settling=moving, settling_noise=still)
    assert np.all(unsettled(exact) > 0)
    rounding = phasors.harmonic_rounding.copy()
    rounding[:, 0] = (0.01 * np.abs(phasors.z)) ** 2
    assert not np.any(unsettled(replace(exact, harmonic_rounding=rounding)))


# ------------------------------------------------------------------------------ the story of the figures


def test_a_peak_from_the_other_joints_controller_is_recognised() -> None:
    """Weakly damped control: one record shows its resonance, H11 and H22 do not."""

    def campaign_with(damping_ratio: float) -> tuple[SineRecord, ...]:
        return simulate_records(
            SERIAL,
            PAPER,
            np.geomspace(3, 30, 25),
            controller=Controller(
                bandwidth_hz=[10.0, 8.0],
                damping_ratio=damping_ratio,
                feedforward=False,
                sample_rate_hz=2000,
            ),
            excitation=Excitation(duration_s=1.5, pattern="one-at-a-time"),
            measurement=Measurement(position_noise_rad=1e-5, torque_noise_Nm=3e-3),
        )

    case = evidence(campaign_with(0.2), SERIAL, method="weighted")
    (story,) = said(findings(case), "comes from the controller of joint 1")
    assert story.level == "note"
    assert "peak of joint 2 at 9.49 Hz" in story.title
    assert "H22, which has no peak" in story.detail
    calm = evidence(campaign_with(0.7), SERIAL, method="weighted")
    assert not said(findings(calm), "comes from the controller")


# ------------------------------------------------------------------------------- one record is not right


def six(**changes: Any) -> list[SineRecord]:
    """Three frequencies, two records each, as a newcomer measures."""
    frequencies, torques = campaign(BAND_HZ[1:6:2], 2)
    settings: dict[str, Any] = {"noise": (1e-5, 3e-3), "periods": 20.37, "seed": 3}
    settings["sample_rate_hz"] = 400.0
    return steady_records(SERIAL, PAPER, frequencies, torques, **{**settings, **changes})


def one_scaled(
    records: list[SineRecord], k: int, angle: Any = 1.0, torque: Any = 1.0
) -> list[SineRecord]:
    changed = list(records)
    theta = records[k].theta_rad * np.asarray(angle)
    changed[k] = remade(
        records[k], theta_rad=theta, tau_Nm=records[k].tau_Nm * np.asarray(torque), label="odd.csv"
    )
    return changed


@pytest.mark.parametrize(
    ("k", "method"),
    [(0, "auto"), (5, "weighted"), (3, "least-squares")]
    + [long(k, "auto") for k in range(1, 6)]
    + [long(k, "weighted") for k in range(1, 5)]
    + [long(k, "least-squares") for k in (1, 2, 4, 5)],
)
def test_one_record_in_degrees_is_named_without_a_finding_about_inertia(k: int, method: str) -> None:
    analysis = analysed(one_scaled(six(), k, angle=180 / np.pi), method=method)
    first = analysis.findings[0]
    assert first.level == "problem"
    assert '"odd.csv" seems to be in degrees' in first.title, titles(analysis)
    assert "57.3" in first.detail
    assert "π/180" in first.remedy
    assert "nertia" not in titles(analysis)
    assert len(unsound(analysis)) == 1, titles(analysis)
    assert len(analysis.fit.candidates) < 12, "no model explains it, and the search ends early"


@cache
def paper_with_friction() -> Study:
    """Half the records of a sample whose joints stick."""
    study = load_study(Path(__file__).parents[1] / "sample_data" / "paper.zip")
    return replace(study, records=study.records[::2])


@pytest.mark.parametrize(
    ("k", "angle", "torque", "title", "factor"),
    [
        (5, 1.0, 1.5, 'The torque in "odd.csv" differs in scale', 1.5),
        long(0, 1.0, [0.8, 1.0], 'The torque of joint 1 in "odd.csv" differs in scale', 0.8),
        long(11, [1.0, 0.01], 1.0, 'The position of joint 2 in "odd.csv" differs in scale', 0.01),
        (11, 180 / np.pi, 1.0, 'The position in "odd.csv" seems to be in degrees', 180 / np.pi),
    ],
)
def test_one_wrong_record_is_named_beside_friction(
    k: int, angle: Any, torque: Any, title: str, factor: float
) -> None:
    study = paper_with_friction()
    records = list(study.sine_records)
    right = records[k]
    records[k] = replace(
        right, theta_rad=right.theta_rad * angle, tau_Nm=right.tau_Nm * torque, label="odd.csv"
    )
    row, finding = outlier(replace(study, records=records)) or (-1, None)
    assert row == k
    assert finding is not None
    assert title in finding.title
    told = re.search(r"is ([\d.]+) times the value expected", finding.detail)
    assert told is not None
    assert float(told[1]) == pytest.approx(factor, rel=0.005)


def test_records_with_friction_do_not_contradict_each_other() -> None:
    assert outlier(paper_with_friction()) is None


def outlier(study: Study) -> tuple[int, Finding] | None:
    """The record that contradicts the others, where only a linear fit is known."""
    phasors = extract_phasors(study.sine_records)
    fit = identify_each(phasors, study.sine_prior, ["weighted"])["weighted"]
    return one_record_off(Evidence(study.records, study.inertias, phasors, fit, {}))


def test_record_of_another_robot_is_named_without_a_factor() -> None:
    other = steady_records(
        PARALLELOGRAM, Elasticity([150.0, 30.0], PAPER.D), FREQUENCIES, TORQUES, noise=(1e-5, 3e-3)
    )
    records = sound()
    records[6] = remade(other[6], label="stranger.csv")
    found = findings(evidence(records, SERIAL, method="weighted"))
    assert '"stranger.csv" contradicts all other records' in found[0].title
    assert "No factor" in found[0].detail


@pytest.mark.parametrize("row", [0, long(6)])
def test_inaccurate_inertias_do_not_hide_the_exchanged_torques_of_one_record(row: int) -> None:
    records = sound()
    records[row] = remade(records[row], tau_Nm=records[row].tau_Nm[:, ::-1], label="odd.csv")
    analysis = analysed(records, Inertia(0.97 * SERIAL.M, 1.03 * SERIAL.M2))
    assert '"odd.csv" contradicts all other records' in titles(analysis)
    assert f"of the other {len(records) - 1} records is 1.1" in analysis.findings[0].detail
    assert len(unsound(analysis)) == 1, titles(analysis)


@pytest.mark.parametrize(
    ("records", "factor"),
    [(sound, 0.97), (six, 0.8)]
    + [long(sound, factor) for factor in (0.5, 0.8, 1.1, 1.5)]
    + [long(six, factor) for factor in (0.5, 0.97, 1.1, 1.5)],
)
def test_a_fault_in_every_record_names_no_single_record(records: Any, factor: float) -> None:
    """Wrong inertias, units or signs of all records are not one record's fault."""
    for case in (
        evidence(records(), Inertia(SERIAL.M, SERIAL.M2 * factor), method="weighted"),
        evidence(records(), Inertia(SERIAL.M * factor, SERIAL.M2), method="weighted"),
    ):
        found = findings(case)
        assert not said(found, "record"), [f.title for f in found]
        assert case.fit.misfit > 3
        assert any("inertia" in f.remedy.lower() for f in found if f.level in ("problem", "warning"))


def test_wrong_frequency_is_the_only_finding() -> None:
    records = sound()
    records[4] = remade(records[4], frequency_hz=records[4].frequency_hz * 1.05, label="five.csv")
    found = findings(evidence(records, SERIAL, method="weighted"))
    assert "stated frequency" in found[0].title
    assert "1 record is affected" in found[0].detail
    for word in ("transfer matrix", "nertia", "contradicts all"):
        assert not said(found, word), [f.title for f in found]


def test_numbers_agree_with_their_nouns() -> None:
    analysis = analysed(sound()[:-1], method="weighted")
    assert said(analysis.findings, "1 frequency has no transfer matrix")


def test_friction_and_lag_together_are_both_named() -> None:
    case = of_rubbing(friction=True)
    late = replace(case, fit=replace(case.fit, delay=4e-4, delay_error=2e-6))
    (both,) = said(against_the_paper(late), "Friction and a torque lag matter")
    assert "lags by 0.4 ms" in both.detail
    by_chance = replace(case, fit=replace(case.fit, delay=4e-8, delay_error=2e-6))
    assert said(against_the_paper(by_chance), "Friction matters")


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (5.4e-5, 2, "5.4×10⁻⁵"),
        (2.2e3, 2, "2200"),
        (1.7e9, 2, "1.7×10⁹"),
        (0.1, 2, "0.1"),
        (-0.02, 2, "−0.02"),
        (99999.6, 2, "100000"),
        (0.0, 3, "0"),
        (np.inf, 2, "∞"),
    ],
)
def test_numbers_in_findings_are_rounded(value: float, digits: int, text: str) -> None:
    assert number(value, digits) == text


# --- which side of the gear


# --- positions of the arm


def of_arm(found: Sequence[Finding]) -> list[Finding]:
    arm = said(found, "positions seem to be measured at the arm")
    return arm + said(found, "measured behind the gears")


def test_friction_is_not_reported_as_arm_angles() -> None:
    records = list(rubbing())
    assert not of_arm(wrong_data(extract_phasors(records), [PARALLELOGRAM] * len(records)))


def exchanged(*order: int) -> list[SineRecord]:
    """Records with the torques in another order."""
    return [remade(r, tau_Nm=r.tau_Nm[:, list(order)]) for r in sound()]


@pytest.mark.parametrize(
    ("records", "inertia", "title"),
    [
        (sound, Inertia(SERIAL.M[::-1], SERIAL.M2[::-1, ::-1]), "inertias of joints 1 and 2 look swap"),
        (lambda: exchanged(1, 0), SERIAL, "torques of joints 1 and 2 look swapped"),
        (sound, Inertia(SERIAL.M, SERIAL.M2 * [[1, -1], [-1, 1]]), "Joint 1 or joint 2 looks reversed"),
        (
            sound,
            Inertia(SERIAL.M[::-1], SERIAL.M2[::-1, ::-1] * [[1, -1], [-1, 1]]),
            "look swapped, and joint 1 or joint 2 looks reversed",
        ),
        (lambda: scaled(torque=0.5**0.5), SERIAL, "seems to be an rms value in place of the peak"),
        (lambda: scaled(angle=1e6), SERIAL, "seems to be in µrad, or time is probably in seconds"),
        long(
            lambda: scaled(torque=2.0),
            SERIAL,
            "gear ratio, the unit of the torque, or M and M2 look wrong for all",
        ),
    ],
)
def test_exchanged_joints_and_wrong_units_are_found_with_uncertain_inertias(
    records: Any, inertia: Inertia, title: str
) -> None:
    """Uncertain inertias could explain some of them; K and D would then be wrong."""
    study = Study(records(), inertia, inertia_std=0.05)
    first = analyse(study).findings[0]
    assert first.level == "problem"
    assert title in first.title


@pytest.mark.parametrize("wrong", [1.0, 1.45])
def test_exchanged_start_values_of_unknown_inertias_are_named(wrong: float) -> None:
    """Unknown inertias explain any data: K1 would be that of joint 2, without a word."""
    guess = Inertia(SERIAL.M * [wrong, 1 / wrong], SERIAL.M2)
    swapped = Inertia(guess.M[::-1], guess.M2[::-1, ::-1])
    title = "inertias of joints 1 and 2 look swapped"
    right, exchanged = (
        said(analyse(Study(sound(), each, inertia_std=np.inf)).findings, title)
        for each in (guess, swapped)
    )
    assert not right
    assert exchanged[0].level == "problem"


@cache
def of_rubbing_arm() -> Phasors:
    """Coupled joints with friction of about a third of the torque."""
    records = simulate_records(
        SERIAL,
        PAPER,
        np.geomspace(3, 30, 5).round(2),
        excitation=Excitation(velocity_rad_s=4.0, periods=6.5),
        controller=Controller(sample_rate_hz=2000),
        measurement=Measurement(torque_noise_Nm=0.005),
        friction=MotorFriction(coulomb=[0.3, 0.1], step_s=5e-4),
        seed=1,
    )
    return extract_phasors(records)


@pytest.mark.parametrize("std", [0.0, 0.05])
@pytest.mark.parametrize(
    ("given", "title"),
    [
        (Inertia(SERIAL.M, SERIAL.M2 * [[1, -1], [-1, 1]]), "Joint 1 or joint 2 looks reversed"),
        (
            Inertia(SERIAL.M[::-1], SERIAL.M2[::-1, ::-1]),
            "The inertias of joints 1 and 2 look swapped",
        ),
        (Inertia(SERIAL.M, SERIAL.M2 * [[1.5, 1], [1, 0.8]]), None),
        (Inertia(SERIAL.M * [1.6, 0.7], SERIAL.M2), None),
    ],
)
def test_exchanged_or_reversed_axes_are_found_beside_friction(
    given: Inertia, title: str | None, std: float
) -> None:
    """A whole fit decides; other wrong inertias are neither exchanged nor reversed."""
    phasors = of_rubbing_arm()
    fit = identify_elasticity(phasors, given, inertia_std=std)
    case = Evidence((), [given] * phasors.omega.size, phasors, fit, {})
    scorer = Scorer.of(case.phasors, case.inertias)
    found = [finding.title for finding in axes_exchanged(case, scorer)]
    assert len(found) == (title is not None)
    assert all(title and each.startswith(title) for each in found)


@pytest.mark.parametrize(("factor", "level"), [(1.3, "warning"), (2.2, "problem")])
def test_implausible_inertias_make_the_answer_unusable(factor: float, level: str) -> None:
    study = Study(sound(), Inertia(SERIAL.M, SERIAL.M2 * factor), inertia_std=0.05)
    (found,) = said(analyse(study).findings, "inertias look wrong")
    assert found.level == level


def test_no_negative_inertia_is_suggested() -> None:
    """Gravity on a light arm at low frequency: the torque opposes the acceleration."""
    inertia = Inertia([1e-3], [[2e-3]])
    frequencies, torques = campaign([2.0, 2.5, 3.1, 3.7, 4.6, 5.7], 1)
    records = steady_records(
        inertia, Elasticity([5.0], [0.01]), frequencies, torques, noise=(1e-6, 1e-4)
    )
    pulled = [remade(r, tau_Nm=r.tau_Nm + 8.0 * r.theta_rad) for r in records]
    found = findings(evidence(pulled, inertia, method="weighted"))
    assert not any(re.search(r"J\S* = −", f.detail) for f in found)
    assert said(found, "A spring or gravity acts on joint 1") or said(found, "sign of the")


@pytest.mark.parametrize(("other", "named"), [("delay", True), ("cubic", False)])
def test_a_filter_is_a_wrong_hold_only_where_a_delay_explains_the_data(other: str, named: bool) -> None:
    """A position filter of half a sample, with the model that explains the data as well."""
    case = evidence(sound(), SERIAL, method="auto")
    interval = case.records[0].interval_s
    layout = ParameterLayout.of(2, effects=["position_filter"])
    p = layout.named(np.append(case.fit.estimate, [-0.5 * interval] * 2))
    chosen = replace(case.fit.candidates[0], parts=("position_filter",), chosen=True)
    twin = replace(chosen, parts=(other,), chosen=False)
    fit = replace(case.fit, parameters=p, candidates=(chosen, twin))
    assert bool(half_a_sample(replace(case, fit=fit))[0]) == named


def test_a_filter_of_the_other_signal_is_named_once() -> None:
    """The title of a position filter names the torque filter that explains the data as well."""
    case = evidence(sound(), SERIAL, method="auto")
    layout = ParameterLayout.of(2, effects=["position_filter"])
    p = layout.named(np.append(case.fit.estimate, [2e-4] * 2))
    chosen = replace(case.fit.candidates[0], parts=("position_filter",), chosen=True)
    twin = replace(chosen, parts=("torque_filter",), chosen=False)
    C = 1e-10 * np.eye(p.vector.size)
    fit = replace(case.fit, parameters=p, parameter_covariance=C, candidates=(chosen, twin))
    (found,) = effects_found(replace(case, fit=fit))
    assert found.title == "The positions are filtered, or the torques are delayed by a filter"
    assert "cannot distinguish these" in found.detail


def test_indistinguishable_effects_are_named_together() -> None:
    case = evidence(sound(delay_s=0.0005, told=False), SERIAL, method="auto")
    assert case.fit.delay is not None
    (chosen,) = (c for c in case.fit.candidates if c.chosen)
    twin = replace(chosen, parts=("torque_filter",), chosen=False)
    others = (chosen, twin)
    (lag,) = said(torque_lags(replace(case, fit=replace(case.fit, candidates=others))), "torque lags")
    assert lag.title == "The torque lags by 0.5 ms, or there is a torque filter"
    assert "cannot distinguish these" in lag.detail
    far = replace(twin, criterion=twin.criterion + 20)
    (lag,) = torque_lags(replace(case, fit=replace(case.fit, candidates=(chosen, far))))
    assert lag.title == "The torque lags by 0.5 ms"


def test_a_single_joint_does_not_separate_gear_and_link() -> None:
    """The answer is the spring of both, which a link of 12 times the resonance puts 10 errors off."""
    inertia, elasticity = ROBOTS[1]
    frequencies, torques = campaign(BAND_HZ, 1)
    records = steady_records(inertia, elasticity, frequencies, torques, noise=(1e-6, 1e-4))
    (link,) = said(findings(evidence(records, inertia, method="weighted")), "gear and link in series")
    assert link.level == "note"
    assert not said(of_sound_data(), "in series")


def with_torques(change: str) -> list[SineRecord]:
    """Sound records, two of each frequency, with other torques."""
    records = sound()
    torques = [record.tau_Nm for record in records]
    if change == "other frequencies":
        torques = torques[6:] + torques[:6]
    if change == "another clock":
        turned = TORQUES * np.exp(2j * np.arange(len(TORQUES)))[:, None]
        late = steady_records(SERIAL, PAPER, FREQUENCIES, turned, noise=(1e-5, 3e-3), periods=20.37)
        torques = [record.tau_Nm for record in late]
    if change == "clipped":
        torques = [
            np.clip(torque, *(0.6 * np.ptp(torque) * np.array([-0.5, 0.5]))) for torque in torques
        ]
    if change.startswith("no sign"):
        load = 0.8 if change.endswith("under load") else 0.0
        torques = [np.abs(torque + load * torque.max(axis=0)) for torque in torques]
    lengths = [record.samples for record in records]
    return [
        remade(record, tau_Nm=np.resize(torque, (length, 2)))
        for record, torque, length in zip(records, torques, lengths, strict=True)
    ]


@pytest.mark.parametrize(
    ("change", "title", "detail"),
    [
        ("other frequencies", "do not belong to the motions", "lacks the frequency"),
        ("another clock", "do not belong to the motions", "would absorb power"),
        ("clipped", "is clipped", "of the samples are at the largest torque"),
        ("no sign", "has no sign", "reaches zero but keeps its sign, with a component at twice"),
        (
            "no sign under load",
            "has no sign",
            "reaches zero but keeps its sign, with a component at twice",
        ),
    ],
)
def test_torques_of_other_motions_are_named_without_a_long_search(
    change: str, title: str, detail: str
) -> None:
    analysis = analysed(with_torques(change))
    assert title in analysis.findings[0].title, titles(analysis)
    assert detail in analysis.findings[0].detail
    assert analysis.state == "not usable"
    assert len(analysis.fit.candidates) <= 4
    assert not any(
        set(each.parts) - {"friction", "viscous", "delay"} for each in analysis.fit.candidates
    )


def test_a_torque_in_coarse_steps_is_not_reported_as_clipped() -> None:
    """A sine spends much of its time on the outer step; the fault is the angles in degrees."""
    step = max(np.abs(record.tau_Nm).max() for record in sound()) / 5
    records = [
        remade(
            record,
            tau_Nm=np.round(record.tau_Nm / step) * step,
            theta_rad=np.degrees(record.theta_rad),
        )
        for record in sound()
    ]
    found = titles(analysed(records))
    assert "clipped" not in found
    assert "in degrees" in found


def test_beside_a_very_large_misfit_no_dependence_on_the_amplitude_is_stated() -> None:
    """It is apparent only: the amplitude changes with another cause."""
    records = in_two_parts(Elasticity(K=[56.0, 9.7], D=PAPER.D), amplitude=3)
    analysis = analysed(records, method="maximum-likelihood")
    assert not said(analysis.findings, "with the deflection"), titles(analysis)
    assert analysis.state == "not usable"


@pytest.mark.parametrize(("harmonic", "named"), [(2, True), (3, False)])
def test_even_harmonics_alone_are_named_as_the_cause_of_a_misfit(harmonic: int, named: bool) -> None:
    """Arms make them in large motions: six axes without encoder noise had a warning without a cause."""
    inertia = Inertia([0.0025, 0.001], [[0.004104, 0.000395], [0.000395, 0.001889]])
    elasticity, rng = Elasticity([20.0, 3.5], [0.1, 0.015]), np.random.default_rng(0)
    records = []
    for record in simulate_records(inertia, elasticity, np.geomspace(3, 30, 4)):
        size = np.abs(record.tau_Nm).max(axis=0)
        turns = 2 * np.pi * harmonic * record.frequency_hz * record.time_s[:, None]
        added = size * (0.002 * np.sin(turns) + 0.01 * rng.normal(size=record.tau_Nm.shape))
        records.append(replace(record, tau_Nm=record.tau_Nm + added))
    found = analyse(Study(records, inertia, inertia_std=0.0))
    assert np.all(np.abs(found.fit.K / elasticity.K - 1) < 0.01)
    assert found.fit.misfit > 3
    assert (found.fit.odd_misfit < 1.5) == named
    (warning,) = (each for each in found.findings if each.level == "warning")
    assert ("Only the even harmonics exceed the noise" in warning.remedy) == named


def test_a_torque_whose_scale_depends_on_its_sign_is_a_cause_of_even_harmonics() -> None:
    """Such a sensor or drive makes even harmonics alone, and K is off: the warning must say so."""
    inertia = Inertia([0.0025, 0.001], [[0.004104, 0.000395], [0.000395, 0.001889]])
    elasticity, rng = Elasticity([20.0, 3.5], [0.1, 0.015]), np.random.default_rng(0)
    records = []
    for record in simulate_records(inertia, elasticity, np.geomspace(3, 30, 4)):
        tau = record.tau_Nm + 0.02 * np.maximum(record.tau_Nm, 0)
        noise = 0.01 * np.abs(tau).max(axis=0) * rng.normal(size=tau.shape)
        records.append(replace(record, tau_Nm=tau + noise))
    found = analyse(Study(records, inertia, inertia_std=0.05))
    np.testing.assert_allclose(found.fit.K / elasticity.K, 1.01, atol=0.002)
    (warning,) = (each for each in found.findings if each.level == "warning")
    assert "a torque whose scale depends on its sign" in warning.remedy
