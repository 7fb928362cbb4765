"""Each rule of the verdict at its thresholds, with handwritten evidence."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.special import fdtri

from jointid import Inertia, MotionRecord, SineRecord
from jointid.errors import JointIdError
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.parameters import ParameterLayout
from jointid.phasors import steady_state
from jointid.phasors.extract import slow_changes
from jointid.uncertainty.answer_tables import PriorRow
from jointid.verdict import (
    cause_findings,
    evidence,
    findings,
    motion_findings,
    rules_causes,
    rules_effects,
    rules_inertia,
    rules_model,
    rules_outlier,
    rules_records,
    rules_response,
    wrong_data,
)
from jointid.verdict.causes import CAUSES, DEGREES, known_cause
from jointid.verdict.scorer import Hypothesis
from jointid.wording import percent


def case(**parts: Any) -> Any:
    """Evidence or a fit with these parts only."""
    return SimpleNamespace(**parts)


def two_joints(**parts: Any) -> Any:
    """A fit of two joints with errors of one per cent, or with other parts."""
    usual = {"n": 2, "estimate": np.array([20.0, 4.0, 0.1, 0.02]), "inflation": 1.0, "method": "auto"}
    usual |= {"misfit": 1.0, "friction": None, "delay": None, "prior": None, "delay_error": None}
    usual |= {"parameters": case(layout={}), "odd_misfit": np.inf, "contradicts_inertias": False}
    fit = case(**{**usual, **parts})
    fit.K, fit.D = np.split(fit.estimate, 2)
    for name in ("standard_error", "noise_error"):
        setattr(fit, name, parts.get(name, 0.01 * np.abs(fit.estimate)))
    return fit


def levels(found: Any) -> list[str]:
    return [finding.level for finding in found]


# --- records


@pytest.mark.parametrize(
    ("off", "level", "weight"),
    [
        (1.99e-3, [], 0),
        (2.01e-3, ["warning"], 10.0),
        (0.0499, ["warning"], 10.05),
        (-0.0499, ["warning"], 10.05),
        (0.0501, ["problem"], 100.05),
        (-0.0501, ["problem"], 100.05),
    ],
)
def test_a_frequency_is_wrong_from_a_difference_of_two_per_mille(
    monkeypatch: pytest.MonkeyPatch, off: float, level: list[str], weight: float
) -> None:
    monkeypatch.setattr(rules_records, "_turns_at", lambda record, found: record)
    phasors = case(frequency_found_hz=np.array([5.0, 8 * (1 + off), 8.0]), labels="abc")
    given = case(phasors=phasors, frequency_hz=np.array([5.0, 8.0, 16.0]), sines=[True, True, False])
    found = list(rules_records.wrong_frequency(given))
    assert levels(found) == level
    for finding in found:
        assert finding.weight == pytest.approx(weight, abs=0.003)
        assert finding.detail.startswith('"b" states 8 Hz')
        assert "1 record is affected" in finding.detail
        assert finding.changes[0].records == (1,)


@pytest.mark.parametrize(("periods", "told"), [(2.998, True), (2.9995, False), (3.0, False)])
def test_periods_below_three_are_few(periods: float, told: bool) -> None:
    phasors = case(duration_s=np.array([periods / 8, 4.0]), labels="ab")
    given = case(phasors=phasors, frequency_hz=np.array([8.0, 8.0]), fit=two_joints())
    found = list(rules_records.few_periods(given))
    assert levels(found) == ["note"] * told
    assert all(finding.weight == pytest.approx(0.006) for finding in found)
    assert all(finding.detail.startswith('"a": 3 periods.') for finding in found)
    phasors.duration_s = np.array([2.5, 2.2]) / 8
    (both,) = rules_records.few_periods(given)
    assert both.detail.startswith('"a" and "b": at least 2.2 periods.')


def test_frequencies_without_a_transfer_matrix_are_counted_and_the_first_is_explained(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(rules_response, "off_frequency", lambda _: ())
    given = case(transfer_matrices={"a": case(rejected=("first",)), "b": case(rejected=("second",))})
    (found,) = rules_response.rejected(given)
    assert found.detail == "first"
    assert found.title == "2 frequencies have no transfer matrix"
    given.transfer_matrices["b"].rejected = ()
    assert next(rules_response.rejected(given)).title == "1 frequency has no transfer matrix"
    monkeypatch.setattr(rules_response, "off_frequency", lambda _: (1,))
    assert not list(rules_response.rejected(given))


@pytest.mark.parametrize(("after", "useful"), [(0.179, True), (0.181, False)])
def test_records_that_leave_nine_tenths_of_the_worst_error_hardly_help(
    monkeypatch: pytest.MonkeyPatch, after: float, useful: bool
) -> None:
    monkeypatch.setattr(findings, "largest_part", lambda _: "Most of it is noise.")
    text = findings.limit_of_records([], two_joints(), np.array([0.2, 0.19, after]))
    assert text == (
        "" if useful else "These records hardly reduce the largest error. Most of it is noise."
    )


@pytest.mark.parametrize(("shared", "told"), [(50, False), (51, True)])
def test_motions_that_share_half_of_their_samples_are_duplicates(shared: int, told: bool) -> None:
    rng = np.random.default_rng(1)
    angle, torque = rng.standard_normal((2, 200, 1))
    first, second = slice(0, 100), slice(100 - shared, 200 - shared)
    records = [
        MotionRecord(np.arange(100) / 100, angle[rows], torque[rows], label=label)
        for label, rows in (("one", first), ("two", second))
    ]
    phasors = case(z=np.zeros((0, 2)), covariance=np.zeros(0))
    found = list(rules_records.counted_twice(case(phasors=phasors, records=records, fit=two_joints())))
    assert levels(found) == ["warning"] * told
    assert all('"one" and "two" have the same samples. Counting' in finding.detail for finding in found)


@pytest.mark.parametrize(
    ("coulomb", "standing", "level"),
    [(0.0299, 1, []), (0.0301, 1, ["note"]), (0.5, 9, ["note"]), (0.5, 10, ["warning"])],
)
def test_a_joint_at_rest_in_nearly_all_records_is_a_warning(
    monkeypatch: pytest.MonkeyPatch, coulomb: float, standing: int, level: list[str]
) -> None:
    stationary = np.zeros((10, 2), bool)
    stationary[:standing, 1] = True
    monkeypatch.setattr(rules_records, "chosen_friction", lambda *_: case(stationary=stationary))
    fit = two_joints(friction=case(coulomb=np.array([0.5, coulomb])))
    fit.errors = {"coulomb": np.array([0.01, 0.01])}
    found = list(rules_records.stationary_joint(case(fit=fit, phasors=case(labels=["r"] * 10))))
    assert levels(found) == level
    for finding in found:
        assert finding.title == f"Joint 2 hardly moves in {standing} of 10 records"
        assert "joint 2 moves less than its noise" in finding.detail
        assert finding.weight % 10 == pytest.approx(0.02 * standing / 10)


def test_joints_held_in_every_record_are_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    """Play of a held joint made it look 40 % softer, and D of another 60 % smaller, each by 6 σ."""
    stationary = np.ones((10, 2), bool)
    monkeypatch.setattr(rules_records, "chosen_friction", lambda *_: case(stationary=stationary))
    fit = two_joints(friction=case(coulomb=np.zeros(2)))
    fit.errors = {"coulomb": np.full(2, 0.01)}
    found = list(rules_records.stationary_joint(case(fit=fit, phasors=case(labels=["r"] * 10))))
    assert levels(found) == ["note"]
    assert found[0].title == "Joints 1 and 2 are held in every record"
    stationary[0, 0] = False
    found = list(rules_records.stationary_joint(case(fit=fit, phasors=case(labels=["r"] * 10))))
    assert found[0].title == "Joint 2 is held in every record"


def test_a_constant_torque_of_a_moving_joint_is_named_once() -> None:
    def record(*constant: bool) -> Any:
        return case(constant=np.array(constant), tau_Nm=np.full((9, 2), 1.5), start=2)

    still, moves = record(True, False, True, True), record(False, False, False, True)
    fine = record(False, True, False, True)
    given = case(records=[fine, still, moves], fit=two_joints(), phasors=case(labels="abc"))
    found = list(rules_records.constant_torque(given))
    assert [f.title for f in found] == ["The torque of joint 2 is constant in 2 of 3 records"]
    assert found[0].detail.startswith('"b" and "c": the joint moves while tau_m2_Nm stays at 1.5 N·m')
    assert found[0].changes[0].records == (1, 2)
    (alone,) = rules_records.constant_torque(
        case(records=[moves], fit=two_joints(), phasors=case(labels="c"))
    )
    assert alone.title.endswith("in 1 of 1 record")
    assert "leave this record out" in alone.remedy
    assert alone.changes == ()  # nothing would be left


@pytest.mark.parametrize(
    ("amplitude", "share", "level", "text"),
    [
        (9.9, 0.1, ["note"], "is coarse for the smallest motion"),
        (10.1, 0.1, [], ""),
        (10.1, 0.49, [], ""),
        (10.1, 0.51, ["note"], "dominates the position noise"),
        (2.9, 0.1, ["warning"], "is coarse"),
        (3.1, 0.1, ["note"], "is coarse"),
    ],
)
def test_an_encoder_is_coarse_below_ten_steps_or_where_it_makes_half_of_the_noise(
    monkeypatch: pytest.MonkeyPatch, amplitude: float, share: float, level: list[str], text: str
) -> None:
    step, samples, joints = 1e-3, 1200, slice(0, 1)
    rounding = step**2 / 12 * 4 / samples
    deviation = np.full((3, 2), np.sqrt(rounding / share))
    monkeypatch.setattr(rules_records, "_encoder_steps", lambda record: np.array([step]))
    held = np.array([[1.0, 1.0], [1.0, 1.0], [0.049, 1.0]])
    monkeypatch.setattr(rules_records, "joint_share", lambda phasors: held)
    q = np.array([[amplitude], [amplitude], [0.1]]) * step  # the last record holds the joint
    phasors = case(standard_deviation=deviation, q=q[:, joints])
    records = [case(samples=samples)] * 3
    fit = two_joints(estimate=np.array([20.0, 0.1]), n=1)
    given = case(phasors=phasors, fit=fit, sines=records, records=records)
    found = list(rules_records.coarse_encoder(given))
    assert levels(found) == level
    assert all(text in finding.title for finding in found)
    assert all(
        f"an amplitude of {evidence.number(amplitude, 2)} steps" in finding.detail for finding in found
    )


# --- settling


def test_a_change_above_one_per_cent_and_five_errors_is_settling() -> None:
    def change(
        settling: float,
        noise: float,
        z: float = 1.0,
        rounding: float = 0.0,
        periods: float = 201.0,
        freedom: float = 200.0,
    ) -> float:
        phasors = case(
            settling=np.array([[settling, 0.0]]),
            settling_noise=np.array([[noise, 1.0]]),
            harmonic_rounding=np.array([[[rounding**2, 0.0], [0.0, 0.0]]]),
            z=np.array([[z, 1.0]]),
            omega=np.array([2 * np.pi]),
            duration_s=np.array([periods]),
            degrees_of_freedom=np.array([freedom]),
            by_frequency=lambda: [(1.0, np.array([0]))],
        )
        return float(steady_state.unsettled(phasors)[0])

    assert change(0.0101, 1e-3) == pytest.approx(0.0101)
    assert change(0.0099, 1e-3) == 0
    assert change(0.0501, 0.01) == pytest.approx(0.0501)
    assert change(0.0499, 0.01) == 0
    assert change(0.02, 0.0) == 0.02
    assert change(0.02, 0.0, rounding=2.7e-3) == 0.02  # of both parts, √2 of it each
    assert change(0.02, 0.0, rounding=2.9e-3) == 0
    assert change(0.02, 0.0, z=2.0, rounding=5.4e-3) == 0.02  # relative to the phasor
    assert change(0.02, 0.0, z=2.0, rounding=5.8e-3) == 0
    # The scatter of two periods is uncertain, however many samples estimate the noise elsewhere.
    assert change(0.53, 0.1, periods=9.0) == 0.53  # from four degrees of freedom: 4.8 errors suffice
    assert change(0.58, 0.1, periods=6.6) == 0  # from three they do not: 5.9 are needed
    assert change(0.6, 0.1, periods=6.6) == 0.6
    assert change(0.4, 0.01, periods=4.3) == 0
    assert change(0.5, 0.01, periods=4.3) == 0.5
    assert change(0.58, 0.1, freedom=6.0) == 0  # of seven blocks, alike
    assert change(0.6, 0.1, freedom=6.0) == 0.6
    assert change(0.58, 0.1, freedom=7.0) == 0


@pytest.mark.parametrize(("periods", "start"), [(6.9, None), (7.5, 1.0), (20.0, 1.0)])
def test_a_start_leaves_five_periods_and_is_confirmed_by_the_next(
    periods: float, start: float | None
) -> None:
    """A transient of less than a period: the first start after it, and one more, must be steady."""
    time, rng = np.arange(int(200 * periods)) / 200, np.random.default_rng(1)
    turn, noise = 2 * np.pi * time, 1e-4 * rng.standard_normal((2, time.size))
    transient = 0.5 * np.exp(-6 * time) * np.sin(1.3 * turn + 1)
    record = SineRecord(1.0, time, np.sin(turn) + transient + noise[0], np.cos(turn) + noise[1])
    assert steady_state.steady_from(record) == start


def test_an_amplitude_that_falls_through_the_whole_record_has_no_steady_start() -> None:
    """Its change becomes insignificant in short remainders, in proportion to their length."""
    time, rng = np.arange(8000) / 200, np.random.default_rng(2)
    turn, noise = 2 * np.pi * time, 0.1 * rng.standard_normal((2, time.size))
    falling = (1 - 0.1 * time / 40) * np.sin(turn)
    record = SineRecord(1.0, time, falling + noise[0], np.cos(turn) + noise[1])
    assert steady_state.steady_from(record) is None


@pytest.mark.parametrize(("hz", "digits"), [(0.09, 0), (0.1, 0), (0.11, 1), (1.0, 1), (1.1, 2), (30, 3)])
def test_starts_have_a_tenth_of_a_period(hz: float, digits: int) -> None:
    assert steady_state.decimals(case(frequency_hz=hz)) == digits  # type: ignore[arg-type]


# --- the answer


@pytest.mark.parametrize(
    ("noise", "whole", "named"),
    [
        ([0.049, 0.049, 0.19, 0.19], [0.29, 0.29, 0.59, 0.59], None),
        ([0.051, 0.01, 0.19, 0.19], [0.06, 0.01, 0.2, 0.2], "K1 is poorly determined"),
        ([0.01, 0.01, 0.01, 0.21], [0.01, 0.01, 0.01, 0.22], "D2 is poorly determined"),
        ([0.01] * 4, [0.01, 0.31, 0.01, 0.01], "K2 is poorly determined"),
        ([0.01] * 4, [0.01, 0.31, 0.61, 0.01], "K2 and D1 are poorly determined"),
        ([0.01] * 4, [0.01, np.inf, 0.01, 0.01], "K2 is poorly determined"),
        ([0.01] * 4, [0.6, 0.7, 2.0, 0.01], "These records do not determine K1 and K2"),
    ],
)
def test_errors_of_five_and_twenty_per_cent_by_noise_are_large(
    noise: list[float], whole: list[float], named: str | None
) -> None:
    p = two_joints().estimate
    for inflation in (1.0, 4.0):
        wide = np.sqrt(inflation) * p
        errors = {"noise_error": wide * noise, "standard_error": wide * whole}
        found = list(rules_model.hardly_known(case(fit=two_joints(inflation=inflation, **errors))))
        assert [finding.title for finding in found] == ([named] if named else [])
        for finding in found:
            assert "not determine" not in finding.title or " of K2 is " in finding.detail
            assert ("infinite" in finding.detail) == bool(np.isinf(whole).any())
            stated = [percent(np.sqrt(inflation) * share) for share in whole if np.isfinite(share)]
            assert np.isinf(whole).any() or any(f" is {each} of" in finding.detail for each in stated)
            assert ("longer" in finding.remedy) == (max(noise) > 0.05)


@pytest.mark.parametrize(
    ("freedom", "detail"),
    [
        (4.0, None),
        (3.9, "only 3 more equations than"),
        (1.0, "only 1 more equation than"),
        (0.9, "no more equations"),
        (0.0, "no more equations"),
    ],
)
def test_few_degrees_of_freedom_are_reported(freedom: float, detail: str | None) -> None:
    hz = np.array([3.0, 3.1])
    fit = two_joints(fundamental=(1.0, freedom))
    given = case(fit=fit, frequency_hz=hz, records=[0, 1], has_motions=False)
    found = list(rules_model.hardly_tested(given))
    assert [detail in finding.detail for finding in found] == ([True] if detail else [])
    assert levels(found) == ["warning"] * (detail is not None)
    given.records = [0]
    assert all("1 record gives " in found.detail for found in rules_model.hardly_tested(given))
    given.has_motions = True  # whose noise is that of the residual
    level = "problem" if freedom < 1 else "warning"
    assert levels(rules_model.hardly_tested(given)) == [level] * (detail is not None)
    for other in (hz, np.array([3.0, 3.0 + 1e-8])):
        linear = two_joints(fundamental=(1.0, 0.0), method="weighted" if other is hz else "auto")
        given = case(fit=linear, frequency_hz=other, records=[0, 1])
        assert not list(rules_model.hardly_tested(given))


@pytest.mark.parametrize(("ratio", "told"), [(1 + 0.9e-6, True), (1 + 1.1e-6, False)])
def test_records_of_one_frequency_cannot_confirm_the_model(ratio: float, told: bool) -> None:
    given = case(frequency_hz=np.array([3.0, 3.0 * ratio]), records=[0, 1], fit=two_joints())
    found = list(rules_model.one_frequency(given))
    assert levels(found) == ["warning"] * told
    assert all("relative phases" in finding.remedy for finding in found)
    assert all(finding.title.startswith("Records at one frequency") for finding in found)
    given.fit.n = 1
    assert not any("relative phases" in finding.remedy for finding in rules_model.one_frequency(given))


def limited(misfit: float, left: float, *, inflation: float = 1.0, K: float = 0.005) -> Any:
    """A fit with a misfit and a residual of some share of the torque."""
    torque = np.ones((6, 2))
    fit = two_joints(misfit=misfit, inflation=inflation, fundamental=(1.0, 0.0), candidates=())
    fit.noise_error = K * fit.estimate
    fit.equations = case(
        spring_torque=torque, omega=np.array([200.0]), noise=case(degrees_of_freedom=np.ones(6))
    )
    fit.residual, fit.residual_noise = left * torque, left / np.sqrt(misfit) * torque
    fit.phasors = case(labels=tuple("abcdef"))
    return fit


@pytest.mark.parametrize(
    ("misfit", "left", "level", "title"),
    [
        (3.0, 0.5, [], ""),
        (3.01, 0.019, ["warning"], "limits the answer"),
        (1100.0, 0.019, ["warning"], "limits the answer"),
        (990.0, 0.0201, ["warning"], "limits the answer"),
        (1010.0, 0.0201, ["problem"], "does not explain the data"),
        (900.0, 0.9e-4, ["note"], "negligible"),
        (900.0, 1.1e-4, ["warning"], "limits the answer"),
    ],
)
def test_a_misfit_matters_with_its_share_of_the_torque(
    monkeypatch: pytest.MonkeyPatch, misfit: float, left: float, level: list[str], title: str
) -> None:
    monkeypatch.setattr(rules_model, "half_a_sample", lambda _: ("", []))
    monkeypatch.setattr(rules_model, "distortion", lambda *_: 0.9e-3)
    for inflation in (1.0, 1.1, 4.0):
        given = case(fit=limited(misfit, left, inflation=inflation), has_motions=False)
        found = list(rules_model.model_limits(given))
        assert levels(found) == level
        for finding in found:
            assert title in finding.title
            assert "widened by a factor of 1.0" not in finding.detail
            widened = "widened by a factor of 2" in finding.detail
            assert widened == (inflation > 2 and finding.level != "note")
    given.fit.method = "weighted"
    assert "problem" not in levels(rules_model.model_limits(given))


@pytest.mark.parametrize(
    ("misfit", "even", "superposed", "level"),
    [
        (20.1, 0.021, False, "problem"),
        (19.9, 0.021, False, "warning"),
        (20.1, 0.019, False, "warning"),
        (20.1, 0.021, True, "warning"),
    ],
)
def test_a_gear_under_a_constant_load_is_a_problem(
    monkeypatch: pytest.MonkeyPatch, misfit: float, even: float, superposed: bool, level: str
) -> None:
    """Such a robot's K was up to eleven standard errors off, with a residual of 1 % of the torque."""
    monkeypatch.setattr(rules_model, "half_a_sample", lambda _: ("", []))
    monkeypatch.setattr(rules_model, "distortion", lambda _, kind="odd": even * (kind == "even"))
    fit = limited(misfit, 0.01)
    fit.phasors.is_superposed = superposed
    (found,) = rules_model.model_limits(case(fit=fit, has_motions=False))
    assert found.level == level
    assert ("gravity does not load" in found.remedy) == (level == "problem")


@pytest.mark.parametrize(
    ("hold", "records", "action"),
    [("State the hold.", (3,), "edit mapping"), ("", (3,), "edit runs"), ("", (), "")],
)
def test_a_misfit_is_corrected_where_its_cause_is(
    monkeypatch: pytest.MonkeyPatch, hold: str, records: tuple[int, ...], action: str
) -> None:
    odd = [evidence.Change("leave out", records)] if records else []
    monkeypatch.setattr(rules_model, "half_a_sample", lambda _: (hold, []))
    monkeypatch.setattr(rules_model, "_odd_record", lambda _: ("", odd))
    monkeypatch.setattr(rules_model, "_usual_cause", lambda *_: "Measure again.")
    (found,) = rules_model.model_limits(case(fit=limited(9.0, 0.01), has_motions=False))
    assert (found.action, found.remedy) == (action, hold or "Measure again.")
    assert [*found.changes] == odd


@pytest.mark.parametrize(("share", "freedom"), [(0.0, 12.0), (1.0, 1 / (1 / 12 + 0.5 * 0.3**2))])
def test_noise_that_is_measured_beyond_the_band_is_less_certain(
    monkeypatch: pytest.MonkeyPatch, share: float, freedom: float
) -> None:
    """Rounding of an encoder differs by 30 % within the band of a motion."""
    monkeypatch.setattr(rules_model, "half_a_sample", lambda _: ("", []))
    monkeypatch.setattr(rules_model, "distortion", lambda *_: 0.0)
    monkeypatch.setattr(rules_model, "_share_of_angles", lambda _: share)
    clear = fdtri(20, freedom, 1 - 3e-4)
    for times, level in ((0.97, []), (1.03, ["warning"])):
        fit = limited(2.0, 0.01)
        fit.fundamental = (times * clear, 20)
        assert levels(rules_model.model_limits(case(fit=fit, has_motions=True))) == level


def test_beside_a_known_payload_the_remedy_is_to_state_the_torque_scale() -> None:
    """The fit takes it as exact otherwise, and the payload contradicts it."""
    for added, std, told in ((1e-3, 0.0, True), (0.0, 0.0, False), (1e-3, 0.05, False)):
        prior = case(added=np.full((2, 2, 2), added), torque_std=std)
        still = case(is_superposed=False)
        given = case(fit=two_joints(prior=prior, friction=object(), phasors=still))
        assert ("under [torque]" in rules_model._usual_cause(given, "")) == told


def test_a_residual_is_negligible_only_beside_well_known_values() -> None:
    assert rules_model._left_of_torque(limited(9.0, 0.9e-4, K=0.0099))[1]
    assert not rules_model._left_of_torque(limited(9.0, 0.9e-4, K=0.0101))[1]
    fit = limited(9.0, 0.5e-4)
    fit.equations.omega = np.array([10.0])  # D counts little: D ω/K = 0.05
    assert not rules_model._left_of_torque(fit)[1]
    fit.residual = 0.9 * fit.residual
    assert rules_model._left_of_torque(fit)[1]


@pytest.mark.parametrize(("misfit", "negligible"), [(2.9, True), (3.1, False)])
def test_an_error_below_the_noise_is_negligible_where_the_harmonics_are_explained(
    misfit: float, negligible: bool
) -> None:
    """A gear with slopes had a warning for 0.006 % of the torque, and K within 0.02 %."""
    for error, known in ((0.9e-3, True), (1.1e-3, False)):
        fit = limited(misfit, 0.001, K=error)
        fit.residual_noise = fit.residual / (1 + 1e-9)
        assert rules_model._left_of_torque(fit)[1] == (negligible and known)


def test_the_error_of_a_model_is_the_residual_beyond_the_noise() -> None:
    """Of data that fit the model it was 39 to 280 % of the torque: noise at the lowest frequencies."""
    fit = limited(1.0, 0.0)
    fit.residual_noise = np.full((6, 2), 0.01)
    fit.residual_noise[0] = 5.0
    fit.residual = fit.residual_noise.copy()
    assert rules_model._left_of_torque(fit)[0] < 1e-9
    fit.residual[1:, 0] = np.hypot(0.01, 0.03)  # the model's error is 3 % of the torque
    assert rules_model._left_of_torque(fit)[0] == pytest.approx(0.03, rel=1e-3)
    fit.residual_noise[0], fit.residual[0] = np.inf, 7.0  # unknown torques
    assert rules_model._left_of_torque(fit)[0] == pytest.approx(0.03, rel=1e-3)
    fit.residual_noise[1:] = 0.0
    assert rules_model._left_of_torque(fit)[0] == pytest.approx(np.hypot(0.01, 0.03))
    fit.residual_noise[:] = np.inf
    assert rules_model._left_of_torque(fit)[0] == 0.0


@pytest.mark.parametrize(
    ("odd", "others", "named"),
    [(4.9, 1.0, False), (5.1, 1.0, True), (14.9, 2.9, True), (16, 3.1, False)],
)
def test_a_record_with_five_times_the_misfit_of_the_others_is_named(
    odd: float, others: float, named: bool
) -> None:
    fit = limited(9.0, 0.1)
    fit.residual = fit.residual_noise * np.sqrt(np.r_[0.5, others, others, odd, others, 0.1])[:, None]
    text, changes = rules_model._odd_record(case(fit=fit, has_motions=False))
    assert bool(text) == named
    assert (f"in the others up to {evidence.times_noise(others)}." in text) == named
    assert [change.records for change in changes] == [(3,)] * named
    fit.phasors = case(labels=tuple("aabbcc"))  # a motion has a row for each line
    text, changes = rules_model._odd_record(case(fit=fit, has_motions=True))
    assert not changes


def test_the_odd_motion_is_that_of_all_its_lines() -> None:
    """Without a proposal to leave it out; a sine has one line."""
    fit = limited(9.0, 0.1)
    fit.residual = fit.residual_noise * np.sqrt([1.0, 1.0, 8.0, 10.0, 2.0, 1.0])[:, None]
    fit.phasors = case(labels=tuple("aabbcc"))
    text, changes = rules_model._odd_record(case(fit=fit, has_motions=True))
    worst, others = evidence.times_noise(9.0), evidence.times_noise(1.5)
    assert f'in "b": {worst}; in the others up to {others}' in text
    assert not changes
    assert rules_model._odd_record(case(fit=fit, has_motions=False)) == ("", [])


def test_usual_causes_are_friction_or_what_a_record_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    def remedy(odd: float, **parts: Any) -> str:
        monkeypatch.setattr(rules_model, "distortion", lambda _: odd)
        return rules_model._usual_cause(case(fit=two_joints(**parts)), "")

    assert "usual causes" in remedy(0.99e-3)
    assert "Check the inertias too" in remedy(1.01e-3)
    assert "Use the estimator auto" in remedy(1.01e-3, method="weighted")
    rubs = {"friction": case(), "phasors": case(is_superposed=False)}
    assert "already includes friction. Check the inertias, the torque constants, backlash" in remedy(
        1.0, **rubs
    )
    known = remedy(1.0, **rubs, parameters=case(layout={"backlash": case()}))
    assert "friction and backlash. Check the inertias, the torque constants and external" in known
    for drift, reverses in ((0.3, False), (0.9, True), (1.9, True), (2.1, False)):
        moving = case(
            is_superposed=True,
            omega=np.array([4.0]),
            q=np.array([[0.5, 0.5j]]),
            drift=np.full((1, 2), -drift),
        )
        assert ("Joints reverse slowly" in remedy(1.0, friction=case(), phasors=moving)) == reverses


@pytest.mark.parametrize(
    ("at", "error", "level"),
    [
        (1.39, 0.06, []),
        (1.41, 0.06, ["warning"]),
        (1 / 1.39, 0.06, []),
        (1 / 1.41, 0.06, ["warning"]),
        (1.41, 0.049, ["note"]),
        (1.41, 0.011, ["note"]),
        (1.41, 0.009, []),
    ],
)
def test_a_resonance_is_missed_beyond_a_factor_of_1_4(
    monkeypatch: pytest.MonkeyPatch, at: float, error: float, level: list[str]
) -> None:
    monkeypatch.setattr(rules_model, "resonances", lambda *_: [5.0, 10.0])
    monkeypatch.setattr(rules_model, "locked_resonances", lambda *_: [5.0, 0.1])
    near = 10 * at if at > 1 else 10.0
    hz = np.array([5.0, near]) if at > 1 else np.array([5.0 * at, 10.0])
    fit = two_joints()
    fit.standard_error = error * fit.estimate
    fit.errors = case(D=0.02 * fit.D)
    fit.elasticity = None
    given = case(
        fit=fit,
        frequency_hz=hz,
        poses=("", ""),
        of_pose=lambda _: (np.array([0, 1]), None),
        records=[case(interval_s=1e-3)],
    )
    assert levels(rules_model.resonance_missed(given)) == level
    monkeypatch.setattr(rules_model, "locked_resonances", lambda *_: [0.1, 0.1])
    few = level or ["note"] * (error < 0.01)  # one resonance alone is not enough for K and D
    assert levels(rules_model.resonance_missed(given)) == few
    fit.inflation = 1.1  # the stated error includes the misfit, as in the table
    for finding in rules_model.resonance_missed(given):
        assert finding.detail.endswith(f"standard error is {percent(error)}.")


@pytest.mark.parametrize(
    ("K", "D", "found"),
    [
        (1.0, -0.019, []),
        (1.0, -0.021, [("warning", "D2 is negative")]),
        (1.0, -0.041, [("problem", "D2 is negative")]),
        (0.0, 0.1, [("problem", "K2 is negative")]),
        (-1.0, -9.0, [("problem", "K2 is negative")]),
    ],
)
def test_negative_values_beyond_their_errors_are_named(
    K: float, D: float, found: list[tuple[str, str]]
) -> None:
    fit = two_joints(estimate=np.array([20.0, K, 0.1, D]))
    fit.errors = case(D=np.full(2, 0.01))
    told = list(rules_model.not_physical(case(fit=fit)))
    assert [(each.level, each.title) for each in told] == found
    assert all(each.weight == {"problem": 102, "warning": 12}[each.level] for each in told)


# --- causes


@pytest.mark.parametrize(
    ("delay", "error", "text"),
    [(1.1e-5, 1e-6, "0.011 ms"), (0.9e-5, 1e-6, None), (-1e-3, 2.4e-4, "1 ms"), (1e-3, 2.6e-4, None)],
)
def test_a_delay_is_reported_from_four_errors_and_a_hundredth_of_a_sample(
    delay: float, error: float, text: str | None
) -> None:
    fit = two_joints(delay=delay, delay_error=error)
    given = case(fit=fit, records=[case(interval_s=1e-3), case(interval_s=1e-3), case(interval_s=1.0)])
    assert rules_causes.lag_size(given) == text
    assert rules_causes.lag_size(case(fit=two_joints(delay_error=None), records=given.records)) is None


@pytest.mark.parametrize(
    ("samples", "held", "text"),
    [
        (0.41, False, "torque_hold = true"),
        (0.59, False, "torque_hold = true"),
        (0.39, False, ""),
        (0.61, False, ""),
        (0.5, True, ""),
        (-0.41, True, "torque_hold = false"),
        (-0.59, True, "torque_hold = false"),
        (-0.39, True, ""),
        (-0.61, True, ""),
        (-0.5, False, ""),
    ],
)
def test_half_a_sample_is_a_hold(samples: float, held: bool, text: str) -> None:
    parameters = case(delay=samples * 1e-3, effect=lambda _: 0.0)
    fit = two_joints(parameters=parameters, candidates=())
    given = case(fit=fit, records=[case(torque_hold=held, interval_s=1e-3)] * 2)
    remedy, changes = rules_causes.half_a_sample(given)
    assert text in remedy
    assert bool(remedy) == bool(text)
    assert [change.values for change in changes] == [(float(not held),)] * bool(text)


def test_a_delay_with_a_torque_filter_of_half_a_sample_together_is_a_hold() -> None:
    """The filter stands for the fall of a hold's magnitude, 1 - (ωT)²/24."""
    parameters = case(delay=0.21e-3, effect=lambda name: 0.29e-3 * (name == "torque_filter"))
    fit = two_joints(parameters=parameters, candidates=())
    given = case(fit=fit, records=[case(torque_hold=False, interval_s=1e-3)])
    assert "torque_hold = true" in rules_causes.half_a_sample(given)[0]


def test_models_of_as_many_parts_within_six_of_the_criterion_are_alternatives() -> None:
    def model(criterion: float, *parts: str, chosen: bool = False) -> Any:
        return case(criterion=criterion, parts=parts, chosen=chosen)

    tried = (
        model(10.0, "friction", "delay", chosen=True),
        model(15.9, "friction", "lag"),
        model(16.1, "friction", "torque_filter"),
        model(9.0, "friction"),
        model(9.0, "friction", "lag", "link"),
        model(9.0, "lag", "link"),
    )
    found = rules_causes.alternatives(case(candidates=tried), "delay")
    assert [*found] == ["lag"]
    assert rules_causes.alternatives(case(candidates=tried[1:]), "delay") == {}


@pytest.mark.parametrize(
    ("significance", "spread", "probability", "told"),
    [
        (4.1, 5.1e-3, 0.9e-4, True),
        (3.9, 0.1, 0.0, False),
        (9, 4.9e-3, 0.0, False),
        (9, 0.1, 1.1e-4, False),
    ],
)
def test_poses_with_different_stiffness_are_reported(
    monkeypatch: pytest.MonkeyPatch,
    significance: float,
    spread: float,
    probability: float,
    told: bool,
) -> None:
    fits = case(
        names=("", "far"),
        significance=np.array([0.0, significance, 9.0, 0.0]),
        spread=np.array([0.9, spread, 1e-4, 0.9]),
        probability=probability,
        estimates=np.array([[20.0, 4.0, 0.1, 0.02], [20.0, 4.1, 0.1, 0.02]]),
        standard_error=np.full((2, 4), 0.02),
    )
    monkeypatch.setattr(rules_causes, "fits_by_pose", lambda *_: fits)
    given = case(poses=("", "far"), fit=two_joints(), phasors=None, inertias=())
    found = list(rules_causes.poses_disagree(given))
    assert [finding.title for finding in found] == ["The poses disagree on K2"] * told
    assert all("0.0 ± 0.5 % (no pose), +2.5 ± 0.5 % (far)." in finding.detail for finding in found)
    given.poses = ("far", "far")
    assert not list(rules_causes.poses_disagree(given))


@pytest.mark.parametrize(
    ("change", "error", "verb"),
    [(5.1e-3, 1e-3, "rises"), (-5.1e-3, 1e-3, "falls"), (4.9e-3, 1e-5, ""), (0.1, 0.021, "")],
)
def test_stiffness_changes_with_the_deflection_from_five_errors_and_per_mille(
    monkeypatch: pytest.MonkeyPatch, change: float, error: float, verb: str
) -> None:
    curve = case(
        change=np.array([0.0, change]),
        standard_error=np.array([0.1, error]),
        deflection_rad=np.array([[0.1, 0.2], [0.3, 0.4]]),
    )
    monkeypatch.setattr(rules_effects, "amplitude_dependence", lambda _: curve)
    monkeypatch.setattr(rules_effects, "contradicts", lambda fit: False)
    given = case(fit=two_joints(parameters=case(layout=())))
    found = list(rules_effects.depends_on_amplitude(given))
    assert [f"joint 2 {verb} with" in finding.title for finding in found] == [True] * bool(verb)
    # No stiffness falls by more than it is, although the slope in shares of K may exceed 1.
    curve.change = np.array([0.0, -4.97])
    (fall,) = rules_effects.depends_on_amplitude(given)
    assert "changes by 99 %" in fall.detail
    monkeypatch.setattr(rules_effects, "contradicts", lambda fit: True)
    assert not list(rules_effects.depends_on_amplitude(given))


def test_distortion_is_that_of_torques_above_four_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    content = case(significance=np.array([[9.0, 9.0, 4.1, 3.9]]), odd=np.array([[0.5, 0.6, 0.02, 0.3]]))
    monkeypatch.setattr(rules_causes, "harmonic_content", lambda _: content)
    given = case(phasors=None, fit=two_joints(method="weighted"))
    assert rules_causes.distortion(given) == 0.02
    assert rules_causes.has_unmodelled_friction(given)
    content.odd = content.odd * 0.99e-3 / 0.02
    assert not rules_causes.has_unmodelled_friction(given)

    def fails(_: Any) -> Any:
        raise JointIdError("too short")

    monkeypatch.setattr(rules_causes, "harmonic_content", fails)
    assert rules_causes.distortion(given) == 0


# --- inertias


def row(difference: float, unit: str = "kg·m²") -> Any:
    """An inertia of 2 ± 0.1 whose fitted value differs by so many standard deviations."""
    return case(
        name="J", unit=unit, given=2.0, given_std=0.1, fitted=2 + 0.1 * difference, fitted_std=0.02,
        disagreement=difference,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("differences", "level", "others"),
    [
        ([3.47, 0.1], [], ""),
        ([3.67, 0.1], ["warning"], ""),
        ([9.99, 0.1], ["warning"], ""),
        ([10.01, 0.1], ["problem"], ""),
        ([4.0, 4.0, 4.0], ["warning"], "Also different: J and J."),
        ([2.2] * 9, ["warning"], ""),  # together
        ([1.4] * 9, [], ""),
    ],
)
def test_significant_differences_of_inertias_are_reported(
    monkeypatch: pytest.MonkeyPatch, differences: list[float], level: list[str], others: str
) -> None:
    monkeypatch.setattr(rules_inertia, "prior_rows", lambda *_: [row(each) for each in differences])
    fit = two_joints(inertias=(Inertia([0.1, 0.1], np.eye(2)),))
    found = list(rules_inertia.inertias_off(case(fit=fit, poses=("",)), fit))
    assert levels(found) == level
    for finding in found:
        assert others in finding.detail
        assert ("wrong unit" in finding.detail) == (finding.level == "problem")
        assert bool(finding.changes) == (finding.level == "warning")


def test_an_absurd_inertia_leads_before_a_coupling_that_gears_may_add(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The prior of a small coupling is narrow: it differs by more standard deviations."""
    rows = [row(each) for each in (30.0, 12.0)]
    for each, name in zip(rows, ("J_12", "J_a1"), strict=True):
        each.name = name
    monkeypatch.setattr(rules_inertia, "prior_rows", lambda *_: rows)
    monkeypatch.setattr(rules_inertia, "_far_coupled", lambda *_: False)
    fit = two_joints(inertias=(Inertia([0.1, 0.1], np.eye(2)),))
    (finding,) = rules_inertia.inertias_off(case(fit=fit, poses=("",)), fit)
    assert finding.level == "problem"
    assert finding.detail.startswith("J_a1 was entered")
    assert "Also different: J_12." in finding.detail
    rows[1].disagreement = 1.0
    (finding,) = rules_inertia.inertias_off(case(fit=fit, poses=("",)), fit)
    assert finding.level == "warning"
    assert "Only couplings differ" in finding.detail


@pytest.mark.parametrize(("change", "level"), [(0.219, "warning"), (0.221, "problem")])
def test_exact_inertias_that_change_stiffness_by_a_fifth_are_a_problem(
    monkeypatch: pytest.MonkeyPatch, change: float, level: str
) -> None:
    """Beyond two standard errors, of one per cent here."""
    wrong = SimpleNamespace(**vars(row(50.0)) | {"given_std": 0.0})
    monkeypatch.setattr(rules_inertia, "prior_rows", lambda *_: [wrong])
    monkeypatch.setattr(rules_inertia, "contradicts", lambda fit: True)
    fit = two_joints(misfit=1000.0)
    own = two_joints(estimate=fit.estimate * (1 + change), inertias=(Inertia([0.1, 0.1], np.eye(2)),))
    own.standard_error = 0.01 * fit.estimate
    found = list(rules_inertia.inertias_off(case(fit=fit, poses=("",)), own))
    assert levels(found) == [level]


@pytest.mark.parametrize(("left", "searches"), [(29.9, True), (30.1, False)])
def test_a_search_with_free_inertias_follows_a_fit_that_explains_most(
    monkeypatch: pytest.MonkeyPatch, left: float, searches: bool
) -> None:
    """Of a misfit of 100; an unsuccessful search would take several seconds."""
    prior = InertiaPrior.of(Inertia([0.1, 0.1], np.eye(2)), 3, 2)
    fit = two_joints(misfit=100.0, prior=prior, parameters=case(layout={"K": 0}), candidates=())
    tried = case(misfit=left, named="near")
    monkeypatch.setattr(rules_inertia, "_probed", lambda *_: None)
    monkeypatch.setattr(rules_inertia, "refit", lambda *_, **__: tried)
    asked: list[Any] = []

    def search(phasors: Any, prior: InertiaPrior, names: list[str], *, start: Any, **_: Any) -> Any:
        asked.append((prior.inertia_std, start))
        return {"auto": two_joints(misfit=explained)}

    monkeypatch.setattr(rules_inertia, "identify_each", search)
    for explained in (2.9, 3.1):
        found = rules_inertia.judged(case(fit=fit, phasors=None, has_motions=False))
        assert (found is not None) == (searches and explained < 3)
    assert asked == [(0.3, "near")] * 2 * searches


@pytest.mark.parametrize(
    ("motions", "std", "effect", "contradicted", "searches"),
    [
        (True, 0.0, "gravity", False, True),
        (True, 0.0, "lag", False, True),
        (True, 0.0, "viscous", False, False),
        (True, 0.0, "viscous", True, True),
        (True, 0.05, "gravity", False, False),
        (False, 0.0, "gravity", False, False),
    ],
)
def test_effects_beside_exact_inertias_of_motions_are_tried_without_these(
    monkeypatch: pytest.MonkeyPatch,
    motions: bool,
    std: float,
    effect: str,
    contradicted: bool,
    searches: bool,
) -> None:
    """A gear ratio 3 % too large gave K 4.5 % or 8 standard errors off, and no warning."""
    given = Inertia([0.1, 0.1], np.eye(2), shared=0.1 * np.eye(2))
    prior = InertiaPrior.of(given, 3, 2, inertia_std=std)
    heavier = (Inertia([0.1, 0.1], 1.1 * np.eye(2)),) * 3
    fit = two_joints(misfit=1.0, prior=prior, inertias=heavier, parameters=case(layout={effect, "M2"}))
    fit.contradicts_inertias = contradicted
    asked: list[InertiaPrior] = []
    monkeypatch.setattr(rules_inertia, "_refitted", lambda _, prior, misfit: asked.append(prior))
    found = rules_inertia.judged(case(fit=fit, has_motions=motions))
    assert (found is None) == searches == bool(asked)
    for free in asked:  # around the payload of the fit
        assert free.inertia_std == 0.3
        np.testing.assert_array_equal(free.M2, [1.1 * np.eye(2)])


def leading(times_sigma: float = -4.1, residual: float = 1.0, **parts: Any) -> Any:
    """A fit of motions with friction and a delay of some standard errors."""
    layout = ParameterLayout.of(2, friction=True, delay=True)
    parts |= {"parameters": layout.named(layout.pack(delay=1e-5 * times_sigma))}
    parts |= {"errors": layout.named(layout.pack(delay=1e-5)), "residual_noise": np.ones((4, 2))}
    return two_joints(residual=np.full((4, 2), residual), **parts)


@pytest.mark.parametrize(
    ("sigmas", "contradicted", "left", "blamed"),
    [
        (-4.1, False, 0.1, False),
        (-3.9, False, 1.0, True),
        (-4.1, True, 0.84, False),
        (-4.1, True, 0.83, True),
        (4.1, False, 1.0, True),
    ],
)
def test_inertias_that_imitate_presliding_friction_are_not_blamed(
    monkeypatch: pytest.MonkeyPatch, sigmas: float, contradicted: bool, left: float, blamed: bool
) -> None:
    """Right inertias looked wrong beside LuGre friction: others left the same residual, and the lead."""
    given = Inertia([0.1, 0.1], np.eye(2))
    parts = {"prior": InertiaPrior.of(given, 3, 2, inertia_std=0.0), "inertias": (given,) * 3}
    fit, own = leading(sigmas, contradicts_inertias=contradicted, **parts), leading(sigmas, left)
    monkeypatch.setattr(rules_inertia, "_refitted", lambda *_: own)
    found = rules_inertia.judged(case(fit=fit, has_motions=True))
    assert (found is own) == blamed


@pytest.mark.parametrize(
    ("sigmas", "times", "hold", "warns"),
    [
        (-4.1, 3.1, "", True),
        (-4.1, 2.9, "", False),
        (-3.9, 3.1, "", False),
        (4.1, 9.0, "", False),
        (-4.1, 3.1, "State the hold.", False),
    ],
)
def test_torques_that_lead_beside_friction_show_presliding(
    monkeypatch: pytest.MonkeyPatch, sigmas: float, times: float, hold: str, warns: bool
) -> None:
    """K and D of motions with LuGre friction were five stated errors off without a warning."""
    monkeypatch.setattr(rules_causes, "half_a_sample", lambda _: (hold, []))
    given = case(fit=leading(sigmas, times_logged_noise=times))
    assert levels(rules_causes.beyond_logged_noise(given)) == ["warning"] * warns


@pytest.mark.parametrize(
    ("times", "misfit", "warns"), [(12.1, 1.0, True), (11.9, 1.0, False), (12.1, 1.2, False)]
)
def test_a_residual_far_beyond_the_log_is_a_warning_beside_friction(
    times: float, misfit: float, warns: bool
) -> None:
    """K of motions under torques with a dead zone was 37 stated errors off, at a misfit of 0.8."""
    given = case(fit=leading(4.1, times_logged_noise=times, misfit=misfit))
    assert levels(rules_causes.beyond_logged_noise(given)) == ["warning"] * warns


@pytest.mark.parametrize("contradicted", [False, True])
def test_exact_inertias_that_only_together_contradict_motions_are_a_warning(
    monkeypatch: pytest.MonkeyPatch, contradicted: bool
) -> None:
    """With M2 0.5 % wrong no inertia alone was clearly different: D was 4 errors off, no warning."""
    rows = [
        PriorRow(name, "kg·m²", 1.0, 0.0, value, 0.01, True)
        for name, value in (("J_a1", 1.02), ("J_m1", 0.99))
    ]
    monkeypatch.setattr(rules_inertia, "prior_rows", lambda *_: rows)
    monkeypatch.setattr(rules_inertia, "contradicts", lambda _: False)
    fit = two_joints(contradicts_inertias=contradicted)
    own = two_joints(estimate=1.02 * fit.estimate, inertias=(), misfit=1.0)
    found = list(rules_inertia.inertias_off(case(fit=fit, poses=()), own))
    assert levels(found) == ["warning"] * contradicted
    assert all("J_a1 was entered as 1" in each.detail for each in found)
    assert not any("cuts the residual" in each.detail for each in found)  # it is the same


# --- responses, other records


def test_a_peak_stands_out_by_forty_per_cent() -> None:
    def peaks(*height: float) -> list[int]:
        return rules_response._peaks(np.array(height))

    assert peaks(1, 1.41, 1) == [1]
    assert peaks(1, 1.39, 1) == []
    assert peaks(1, 2, 1.5, 3, 1) == [3]  # the first is a shoulder of the second
    assert peaks(1, 2, 1.4, 3, 1) == [1, 3]
    assert peaks(2, 1, 1.5, 0.9, 1) == [2]
    assert peaks(3, 2, 1) == []


@pytest.mark.parametrize(("largest", "clipped"), [(10, False), (11, True)])
def test_a_torqueis_clipped_from_a_tenth_of_the_samples(largest: int, clipped: bool) -> None:
    torque = np.r_[np.full(largest, -2.0), np.linspace(0, 1.9, 100 - largest)]
    assert rules_outlier.is_clipped(torque) == clipped
    for smaller, far_more in ((25, False), (24, True)):  # a fourth of them at a smaller size
        steps = np.repeat([0.0, 1.0, 2.0], [smaller, smaller - largest, 100])
        assert rules_outlier.is_clipped(steps) == far_more == rules_outlier.is_clipped(-steps)


def test_a_torque_without_sign_reaches_zero_and_does_not_pass_it() -> None:
    sine = np.sin(np.linspace(0, 40, 999))
    for torque, one_sign in ((sine, False), (np.abs(sine), True), (sine + 1.1, False)):
        assert rules_outlier.has_one_sign(torque) == one_sign == rules_outlier.has_one_sign(-torque)


@pytest.mark.parametrize(("wrong", "left_out"), [(0, False), (2, True), (3, False)])
def test_records_with_negative_power_can_be_left_out_while_most_remain(
    monkeypatch: pytest.MonkeyPatch, wrong: int, left_out: bool
) -> None:
    power = np.r_[np.full(wrong, 5.01), np.full(6 - wrong, 4.99)]
    monkeypatch.setattr(rules_response, "taken_power", lambda *_: power)
    phasors = case(omega=0, z=0, covariance=0, labels="abcdef")
    found = list(rules_response.motors_take_power(case(phasors=phasors, fit=two_joints())))
    assert levels(found) == ["problem"] * (wrong > 0)
    for finding in found:
        assert finding.detail.startswith(f"In {wrong} of 6 records, the motors would absorb power")
        assert [change.records for change in finding.changes] == [(0, 1)] * left_out


def test_a_joint_without_motion_has_no_share() -> None:
    phasors = case(z=np.array([[2.0, 0.0], [1.0, 0.0]]), by_frequency=lambda: [(5.0, np.array([0, 1]))])
    with np.errstate(all="raise"):
        assert steady_state.joint_share(phasors).tolist() == [[1, 0], [0.5, 0]]


def test_the_factors_of_wrong_units() -> None:
    """Torque over acceleration, logged over expected."""
    factors = [
        ("position", np.pi / 180), ("position", 180 / np.pi),
        ("position", 3.0462e-4), ("position", 3282.8),
        ("position", 6.28319), ("position", 0.159155),
        ("torque", 1000.0), ("position", 0.001), ("torque", 0.707107), ("torque", 1.414214),
        ("time", 1e6), ("time", 1e-6), ("time", 1e12), ("time", 1e-12), ("inertia", 1e-4),
    ]  # fmt: skip
    assert [cause.signal for cause in CAUSES] == [signal for signal, _ in factors]
    assert [cause.factor for cause in CAUSES] == pytest.approx([f for _, f in factors], rel=1e-4)


@pytest.mark.parametrize("factor", [0.999, 1.0, 30.0, 1 / 30])
def test_a_known_cause_is_within_three_per_cent(factor: float) -> None:
    for cause in CAUSES:
        near = known_cause(-cause.factor * factor, 1.03)
        assert (near is cause) == (0.97 < factor < 1.03 and not cause.is_common)


@pytest.mark.parametrize(
    ("factor", "of_cause", "common"),
    [
        ([1e6, 2.9e7], 1e6, True),
        ([1e6, 3.1e7], 1e6, False),
        ([1e6, 3.5e4], 1e6, True),
        ([1e6, 3.2e4], 1e6, False),
        ([1e6, -1e6], 1e6, False),
        ([1.02e-4, 1.03e-4], 1e-4, True),
        ([1.04e-4, 1.04e-4], 1e-4, False),
        ([0.99e-4, 1.02e-4], 1e-4, False),
    ],
)
def test_a_cause_is_common_to_all_joints_within_a_gear(
    factor: list[float], of_cause: float, common: bool
) -> None:
    assert cause_findings._is_common(np.array(factor), of_cause) == common


# --- motions


def test_a_motor_rests_where_it_moves_less_than_three_per_cent_of_its_fast_moves() -> None:
    time = np.arange(1001) / 1000
    half = np.where(time < 0.5, time, 0.5 + 0.02 * (time - 0.5))
    slow = np.where(time < 0.5, time, 0.5 + 0.04 * (time - 0.5))
    angles = np.column_stack([half, slow, 0 * time])
    record = MotionRecord(time, angles, np.zeros_like(angles))
    found = motion_findings.share_at_rest(record)
    assert found == pytest.approx([0.495, 0.0, 1.0], abs=0.02)


@pytest.mark.parametrize(
    ("share", "error", "level"),
    [
        (0.34, 0.4, []),
        (0.36, 0.0099, []),
        (0.36, 0.0101, ["warning"]),
        (0.36, 0.49, ["warning"]),
        (0.36, 0.51, ["problem"]),
        (0.36, np.inf, ["problem"]),
    ],
)
def test_a_joint_at_rest_is_reported_where_its_stiffness_is_unknown(
    share: float, error: float, level: list[str]
) -> None:
    fit = two_joints(friction=case())
    fit.errors = case(K=np.array([1e-3, error]) * fit.K)
    fit.standard_error = np.concatenate([fit.errors.K, fit.D])
    found = list(motion_findings._joints_at_rest(fit, np.array([0.9, share])))
    assert levels(found) == level
    for finding in found:
        assert finding.title == "Joint 2 rests for much of the motion"
        assert ("do not determine K2" in finding.detail) == bool(np.isinf(error))
        assert finding.weight % 10 == pytest.approx(min(error, 1.0))
    fit.errors.K[0] = error * fit.K[0]
    for finding in motion_findings._joints_at_rest(fit, np.array([0.9, share])):
        which = "Joints 1 and 2 rest" if level else "Joint 1 rests"
        assert finding.title == f"{which} for much of the motion"
    fit.friction = None
    assert not list(motion_findings._joints_at_rest(fit, np.array([0.9, 0.9])))


# --- words


def test_findings_weigh_by_level_and_effect() -> None:
    for make, level, least in (
        (evidence.problem, "problem", 100.0),
        (evidence.warning, "warning", 10.0),
        (evidence.note, "note", 0.0),
    ):
        most = 4.0 if level == "note" else 80.0
        for effect, weight in ((0.5, 0.5), (-1.0, 0.0), (np.nan, 0.0), (np.inf, most), (99.0, most)):
            finding = make("t", "d", "r", effect)
            assert (finding.level, finding.weight) == (level, least + weight)


def test_records_of_a_pose_have_its_inertia() -> None:
    records: Any = [case(pose=pose) for pose in ("far", None, "near", "far")]
    given = evidence.Evidence(records, "fgnf", case(), case(), {})  # type: ignore[arg-type]
    for pose, rows, inertia in (("far", [0, 3], "f"), ("", [1], "g"), ("near", [2], "n")):
        index, found = given.of_pose(pose)
        assert (index.tolist(), found) == (rows, inertia)


def test_shares_and_multiples_are_rounded() -> None:
    assert [percent(x) for x in (0.0999, 0.1, 10.0, 10.01, -0.034, 0.00123)] == [
        "10 %", "10 %", "1000 %", "more than 1000 %", "3.4 %", "0.12 %",
    ]  # fmt: skip
    assert evidence.times_noise(999.0**2) == "1000 × noise"
    assert evidence.times_noise(1001.0**2) == "over 1000 × noise"
    assert evidence.some(["a", "b"]) == "a and b"
    assert evidence.some(["a", "b", "c", "d"]) == "a, b, c and d"
    assert evidence.some(["a", "b", "c", "d", "e"]) == "a, b, c and 2 more"
    assert evidence.some(["a and b", "c and d"]) == "a and b; c and d"
    assert evidence.some(["a,1", "b", "c", "d", "e"]) == "a,1; b; c and 2 more"
    assert evidence.relative(np.array([1.0, -1.0, 0.0]), np.array([2.0, 0.0, 0.0])).tolist() == [
        0.5,
        1e3,
        0,
    ]


# --- wrong data


def test_factors_near_a_known_one_are_recognised() -> None:
    for near, known in ((1.3, DEGREES), (1 / 1.3, DEGREES), (1.4, 0.0), (-1.3, -DEGREES)):
        factor = near * DEGREES
        assert wrong_data._snapped(factor) == (known or factor)
    assert wrong_data._snapped(-1.2) == -1.0
    assert wrong_data._snapped(3.0) == 3.0
    assert wrong_data._snapped(1.4) == 1.4  # wrong inertias may be behind it


@pytest.mark.parametrize(("after", "named"), [(1.0, True), (3e5, False)])
def test_a_known_factor_of_one_joint_is_no_cause_beside_a_bad_fit(after: float, named: bool) -> None:
    """Torques in percent beside inertias that are 20 % off made 1/2π of a joint by chance."""
    fault = Hypothesis.of("torque", np.ones(2), np.array([1 / (2 * np.pi), 0.3]))
    found = cause_findings.finding_of(fault, 1e7, after, str, 10.0, np.ones(2))
    assert ("revolutions" in found.title) == named


def test_torques_in_another_unit_may_be_inertias_in_another_one() -> None:
    fault = Hypothesis.of("torque", np.ones(2), np.full(2, 1e-3))
    found = cause_findings.finding_of(fault, 1e7, 1.0, str, 10.0, np.ones(2))
    assert (
        found.title == "M and M2 seem to be in g·m², or the position of all joints seems to be in mrad"
    )
    assert "If M and M2 are right, set the unit of the position of all joints to mrad" in found.remedy


def test_a_factor_weighs_by_its_logarithm() -> None:
    """The largest of all joints, on top of one; that of a problem is 100 more."""
    for factor, weight in (([50.0, 1.0], np.log10(50)), ([1 / 300, 40.0], np.log10(300))):
        fault = Hypothesis.of("torque", np.ones(2), np.array(factor))
        found = cause_findings.finding_of(fault, 1e7, 1.0, str, 10.0, np.ones(2))
        assert found.weight == pytest.approx(101 + weight)


def test_every_sign_and_pair_of_channels_is_a_hypothesis() -> None:
    tried = list(wrong_data._hypotheses(2, None, [Inertia([0.1, 0.1], np.eye(2))]))
    scales = [tuple(h.scale) for h in tried if h.kind in ("angle", "torque")]
    for one in range(4):
        assert tuple(1.0 - 2.0 * (np.arange(4) == one)) in scales
    orders = [tuple(h.order) for h in tried if h.kind == "exchanged"]
    assert {(0, 1, 3, 2), (1, 0, 2, 3), (1, 0, 3, 2)} <= {*orders}
    assert {"arm angle", "gear torque", "reversed axis"} <= {h.kind for h in tried}


def test_known_factors_and_orders_can_be_corrected() -> None:
    one = np.ones(2)
    for factor, kinds in (
        *((each, ["scale"]) for each in (1e3, 1e-3, -1.0, 1e3 * (1 + 0.9e-9))),
        *((each, []) for each in (7.0, 1.0, 1e3 * (1 + 1.1e-9))),
    ):
        fault = Hypothesis.of("torque", one, np.array([1.0, factor]))
        changes = cause_findings._changes(fault)
        assert [change.kind for change in changes] == kinds
        assert all(change.values == (1.0, 1.0, 1.0, factor) for change in changes)
    degrees = Hypothesis.of("angle", np.array([DEGREES, 1 / DEGREES]), one)
    assert [change.kind for change in cause_findings._changes(degrees)] == ["scale"]
    (order,) = cause_findings._changes(replace(fault, order=np.array([1, 0, 2, 3])))
    assert (order.kind, order.values) == ("order", (1.0, 0.0, 2.0, 3.0))


@pytest.mark.parametrize(
    ("order", "scale", "title", "remedy"),
    [
        ([0, 1, 2, 4, 3, 5], 1, "The torques of joints 1 and 2 look swapped", "tau_m1_Nm, tau_m2_Nm"),
        ([0, 1, 2, 3, 5, 4], 1, "The torques of joints 2 and 3 look swapped", "tau_m2_Nm, tau_m3_Nm"),
        ([1, 0, 2, 3, 4, 5], 1, "The positions of joints 1 and 2 look swapped", "theta_m1_rad, "),
        ([1, 0, 2, 4, 3, 5], 1, "The inertias of joints 1 and 2 look swapped", "same order"),
        ([0, 1, 2, 3, 4, 5], -1, "Joint 3 looks reversed relative to the others", "coupling inertias"),
    ],
)
def test_exchanged_channels_are_named(order: list[int], scale: float, title: str, remedy: str) -> None:
    turned = np.array([1.0, 1.0, scale])
    fault = replace(Hypothesis.of("exchanged", turned, turned), order=np.array(order))
    found = cause_findings.axes_look_wrong(fault, "")
    assert found.title == title
    assert remedy in found.remedy


def test_joints_are_listed_in_words() -> None:
    assert cause_findings._joints([0], 1) == "joint 1"
    assert cause_findings._joints([1], 2) == "joint 2"
    assert cause_findings._joints([0, 2], 3) == "joints 1 and 3"
    assert cause_findings._joints([0, 1], 2) == "all joints"


def test_a_time_in_milliseconds_is_reported_with_the_record_length() -> None:
    for title, lasts in (("Time is probably in milliseconds", True), ("M and M2 are probably", False)):
        (cause,) = (each for each in CAUSES if each.title.startswith(title))
        factor = cause.factor * np.array([1.0, 1.09])
        found = cause_findings._common_cause(cause, factor, "", 5000.0, 1.0)
        assert ("The longest record then lasts 5 s" in found.detail) == lasts
        assert "Remaining factor" not in found.remedy
        more = cause_findings._common_cause(cause, factor * [1, 1.02], "", 5000.0, 1.0)
        assert "Remaining factor in joint 2: 1.11." in more.remedy


@pytest.mark.parametrize(
    ("factor", "said", "unsaid"),
    [
        ([1, 50], "left out: 50 in position or torque, or 7.07 in both", "All joints"),
        ([1, 1 / 50], "applied once too often: 50 in position or torque", "The sign"),
        ([1, -50], "The sign of the position or torque of joint 2 is reversed", "All joints"),
        ([1, -1.14], "Inaccurate M and M2 are the likely cause of the size of the factor", "left out"),
        ([1, 1.14], "a torque in multiples of 0.877 N·m", "gear ratio"),
        ([4, 4.06], "a sample rate of 2.01 times the given one", "The sign"),
        ([4, 4.1], "left out", "sample rate"),
        ([-4, -4.06], "is reversed, as with a gear", "sample rate"),
        ([1, 9.9], "Wrong M and M2 have the same effect", "The sign"),
        ([1, 1 / 9.9], "Wrong M and M2 have the same effect", "The sign"),
        ([1, 10.1], "left out: 10.1", "Wrong M and M2"),
        ([1, 2e3], "left out: 44.7 in both; or a torque", "position or torque, or"),
        ([1, 2e6], "The cause may be a torque in multiples of 5.00×10⁻⁷ N·m", "gear ratio"),
    ],
)
def test_an_unknown_factor_may_be_a_gear_ratio(factor: list[float], said: str, unsaid: str) -> None:
    factors = np.array(factor, float)
    wrong = np.flatnonzero(factors != 1)
    found = cause_findings._unknown_cause(factors, wrong, "", 1.0, "both")
    assert said in found.detail
    assert unsaid not in found.detail
    assert ("both: position and torque seem to be" in found.detail) == ("gear ratio" in found.detail)
    assert found.title.endswith("all joints" if factors.all() and wrong.size == 2 else "joint 2")


@pytest.mark.parametrize(
    ("given", "coupling", "noise", "title"),
    [
        (1.0, 0.0, 0.0, None),
        (1.3, 0.0, 0.0, "The inertias look wrong in pose low"),
        (1.1, -0.3, 0.0, "The inertias look wrong in pose low"),
        (1.3, 0.0, 0.6, None),
        (-1.0, 0.0, 0.0, "A spring or gravity acts on joint 2 at low frequency in pose low"),
    ],
)
def test_inertias_that_are_far_off_at_low_frequency_are_named(
    monkeypatch: pytest.MonkeyPatch, given: float, coupling: float, noise: float, title: str | None
) -> None:
    measured = np.diag([1.0, given])
    measured[0, 1] = measured[1, 0] = coupling
    monkeypatch.setattr(rules_inertia, "distortion", lambda _: 0.0)
    alone: list[Any] = [case(expected_cost=1.0, cost=100.0), case(expected_cost=0.0, cost=0.0)]
    monkeypatch.setattr(rules_inertia, "refit", lambda *_: alone[0])
    monkeypatch.setattr(rules_inertia, "low_frequency_inertia", lambda *_: measured)
    monkeypatch.setattr(rules_inertia, "_unexplained", lambda *_: noise)
    fit = two_joints(misfit=1e4)
    fit.phasors = case(select=lambda _: None)
    inertia = Inertia([0.4, 0.4], np.diag([0.6, 0.6]))
    evidence_of = case(fit=fit, poses=("low", "low"), of_pose=lambda _: (np.array([0, 1]), inertia))
    evidence_of.phasors = fit.phasors
    found = list(rules_inertia._far_off(evidence_of))
    assert [each.title for each in found] == [title] * (title is not None)
    if given > 1 and found:
        element = (
            "J_12 = −0.3 kg·m² (entered: 0)" if coupling else "J_m2 + J_a2 = 1.3 kg·m² (entered: 1)"
        )
        assert f"gives about {element}" in found[0].detail
        assert found[0].weight == pytest.approx(100.3)
    alone[0] = alone[1]  # as many unknowns as equations
    assert len(list(rules_inertia._far_off(evidence_of))) == len(found)
    by_pose = {"low": alone[1], "right": case(expected_cost=1.0, cost=99.0)}  # right by itself
    evidence_of.poses = ("right", "low", "right")
    evidence_of.of_pose = lambda pose: (np.array([0, 1]), case(M=inertia.M, M2=inertia.M2, pose=pose))
    monkeypatch.setattr(rules_inertia, "refit", lambda _, inertia, __: by_pose[inertia.pose])
    assert [each.title for each in rules_inertia._far_off(evidence_of)] == [each.title for each in found]
    monkeypatch.setattr(rules_inertia, "refit", lambda *_: alone[0])
    alone[0] = by_pose["right"]
    assert not list(rules_inertia._far_off(evidence_of))
    alone[0], fit.misfit = alone[1], 99.0
    assert not list(rules_inertia._far_off(evidence_of))


@pytest.mark.parametrize(("least", "told"), [(4.1, True), (3.9, False)])
def test_arms_behind_gears_of_two_and_more_may_have_inertias_of_the_other_side(
    least: float, told: bool
) -> None:
    """Of both joints; one arm of a negative inertia is none."""
    inertia = Inertia([0.1, 0.2], np.diag([5.0, 8.0]))
    for own in ([5.0 / 9, 8.0 / least], [5.0 / 9, -1.0]):
        tried = wrong_data._hypotheses(2, np.diag(inertia.M + own), [inertia])
        found = [each.gear for each in tried if each.kind == "inertia"]
        assert len(found) == (told and own[1] > 0)
        assert all(gear == pytest.approx([3.0, np.sqrt(least)]) for gear in found)


@pytest.mark.parametrize("size", [1e-4, 1.0, 1e3])
def test_inertias_far_off_are_named_of_robots_of_any_size(
    monkeypatch: pytest.MonkeyPatch, size: float
) -> None:
    """A tenth of the joint's own of a small one is nearly nothing in kg·m²; a quarter is too much."""
    monkeypatch.setattr(rules_inertia, "_explained_alone", lambda *_: False)
    monkeypatch.setattr(rules_inertia, "_unexplained", lambda *_: 0.01)
    fit = two_joints(misfit=1e4)
    fit.phasors = case(select=lambda _: None)
    inertia = Inertia(size * np.array([4.0, 0.04]), size * np.diag([6.0, 0.06]))
    given = case(fit=fit, poses=("",), of_pose=lambda _: (np.array([0]), inertia))
    for odd, small, large, joint in (
        (0.019, 1.1, 1.0, 0), (0.019, 1.0, 1.25, 1), (0.019, 1.25, 1.1, 2), (0.021, 1.25, 1.1, 0),
    ):  # fmt: skip
        monkeypatch.setattr(rules_inertia, "distortion", lambda _, odd=odd: odd)
        measured = size * np.diag([10 * large, 0.1 * small])
        monkeypatch.setattr(rules_inertia, "low_frequency_inertia", lambda *_, m=measured: m)
        found = list(rules_inertia._far_off(given))
        assert len(found) == (joint > 0)
        assert all(f"J_m{joint} + J_a{joint} = " in each.detail for each in found)


@pytest.mark.parametrize(("unsigned", "told"), [(2, True), (1, False), (0, False)])
def test_torques_without_a_sign_are_those_of_all_motions(
    monkeypatch: pytest.MonkeyPatch, unsigned: int, told: bool
) -> None:
    monkeypatch.setattr(motion_findings, "share_at_rest", lambda _: np.array([0.0, 1.0]))
    monkeypatch.setattr(motion_findings, "has_one_sign", lambda tau: bool(tau[0] < unsigned))
    monkeypatch.setattr(motion_findings, "is_clipped", lambda _: False)
    motions: Any = [case(label=f"m{k}", start=0, tau_Nm=np.full((9, 2), k + 0.5)) for k in range(2)]
    found = list(motion_findings.damaged_torques(motions))
    assert [each.title for each in found] == ["A logged torque has no sign"] * told
    assert all('In 2 of 2 motions, no torque changes its sign: "m0" and "m1"' in f.detail for f in found)


def test_responses_are_the_motions_under_one_torque_at_a_time() -> None:
    H = np.array([[[1.0, 2.0], [3.0, 4.0]]])
    matrix = case(omega=np.array([2.0]), H=H, covariance=np.zeros((1, 4, 4)))
    records: Any = [case(time_s=np.array([1.0, 9.0]), pose=pose) for pose in (None, "far")]
    given: Any = [case(n=2, pose="near"), case(n=2, pose="far")]
    motions, inertias = motion_findings._responses(records, given, {"far": matrix})
    assert motions.q.real.tolist() == [[-0.25, -0.75], [-0.5, -1.0]]
    assert motions.tau.real.tolist() == [[1, 0], [0, 1]]
    assert motions.duration_s.tolist() == [8.0, 8.0]
    assert inertias == [given[1]] * 2
    # Elements of H in one column, in the order H11, H12, H21, H22, have common noise.
    C = np.diag([1.0, 2.0, 3.0, 4.0])
    C[0, 2] = C[2, 0] = 0.5
    both = case(omega=np.array([2.0, 4.0]), H=np.tile(H, (2, 1, 1)), covariance=np.stack([C, 10 * C]))
    motions, inertias = motion_findings._responses(records, given, {"far": both})
    assert motions.omega.tolist() == [2.0, 2.0, 4.0, 4.0]
    assert len(inertias) == 4
    first, second = np.array([[1, 0.5], [0.5, 3]]), np.diag([2.0, 4.0])
    for found, expected in zip(
        motions.covariance, (first / 16, second / 16, 10 * first / 256, 10 * second / 256), strict=True
    ):
        np.testing.assert_allclose(found[:2, :2], expected)
        assert not found[2:].any()


# --- records, more


@pytest.mark.parametrize(("amplitude", "found"), [(0.22, False), (0.34, True)])
def test_a_motor_turns_at_another_frequency_where_that_sine_stands_out(
    amplitude: float, found: bool
) -> None:
    """Beyond 25 + 2 ln N times the noise: an amplitude of 0.28 in 1000 samples."""
    time = np.arange(1010) / 1000
    quiet, noise = np.random.default_rng(4).standard_normal((2, 1010))
    theta = np.column_stack([0.1 * quiet, amplitude * np.sin(2 * np.pi * 16 * time) + noise])
    theta[:10] = 1e3  # before the start
    record: Any = case(time_s=time, theta_rad=theta, start=10, frequency_hz=8.0)
    assert rules_records._turns_at(record, 16.0) == found


def test_settling_records_are_named_with_later_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    moving = np.array([0.0, 0.02, 0.5, 0.03, 0.04])
    starts: dict[int, float | None] = {1: 9.0, 2: 1.25, 3: None, 4: 2.0}
    monkeypatch.setattr(rules_records, "unsettled", lambda _: moving)
    monkeypatch.setattr(rules_records, "steady_from", lambda record: starts[record.k])
    records = [case(k=k, frequency_hz=3.0) for k in range(5)]
    given = case(records=records, phasors=case(labels=list("abcde")))
    (found,) = rules_records.still_settling(given)
    assert (found.level, found.weight, found.action) == ("warning", 10.5, "edit runs")
    assert found.detail == (
        '4 records are affected: "c", "e", "d" and "b". In "c" the first quarter differs by 50 % from '
        'the second half. Steady: "c", from 1.25 s on; "e", from 2.00 s on. "d" does not become steady.'
    )
    assert "at these times" in found.remedy
    assert "Measure the others again." in found.remedy
    assert [(c.kind, c.records) for c in found.changes] == [("start", (2, 4, 3, 1))]
    moving[:] = [0, 0, 0, 0.02, 0]
    (found,) = rules_records.still_settling(given)
    assert found.detail.startswith('In "d" the first quarter differs by 2.0 % from the second half.')
    assert (found.remedy, found.changes) == ("Measure again. Wait longer before recording.", ())
    moving[:] = [0, 0.02, 0.5, 0, 0]
    (found,) = rules_records.still_settling(given)
    assert found.detail.startswith('2 records are affected: "c" and "b". In "c" the first quarter')
    moving[:] = [0, 0.02, 0, 0, 0]
    (found,) = rules_records.still_settling(given)
    assert "Start the record at this time" in found.remedy
    assert "others" not in found.remedy
    moving[:] = 0
    assert not list(rules_records.still_settling(given))


@pytest.mark.parametrize(
    ("difference", "noise", "told"),
    [(0.9e-12, 1e-6, True), (1.1e-12, 1e-6, False), (0.0, 0.0, False)],
)
def test_sines_with_the_same_phasors_are_duplicates(difference: float, noise: float, told: bool) -> None:
    """Without noise, as in a simulation, equal records are no copies."""
    z = np.array([[1.0 + 1j, 2.0, 0.0], [1.0 + 1j, 2.0, 0.0], [3.0, 4.0, 0.0]])  # a joint rests
    z[1] *= 1 + difference
    phasors = case(
        z=z,
        covariance=noise * np.ones((3, 2, 2)),
        by_frequency=lambda: [(1.0, np.array([2])), (2.0, np.array([0, 1]))],
        labels="abc",
    )
    given = case(phasors=phasors, records=[1, 2, 3], fit=two_joints())
    found = list(rules_records.counted_twice(given))
    assert levels(found) == ["warning"] * told
    for finding in found:
        assert finding.detail.startswith('"a" and "b" have the same samples. Counting')
        assert finding.weight == pytest.approx(10.004)
        assert [(c.kind, c.records) for c in finding.changes] == [("leave out", (1,))]
    phasors.covariance = np.arange(3)[:, None, None] + phasors.covariance
    assert not list(rules_records.counted_twice(given))


def foreign(
    level: float,
    *,
    rows: tuple[int, ...] = (0, 1),
    poor: bool = False,
    moves: float = 1.0,
    inertia: float = 1.0,
    noise: float = 0.1,
) -> list[Any]:
    """Findings on four records; in some the torque has this amplitude at the motion's frequency."""
    time = np.arange(200) / 100
    frequency = np.array([2.0, 3.5, 5.0, 6.5])
    lost = np.isin(np.arange(4), rows)
    amplitude = np.where(lost, level, 1.0)
    # The rest of the torque, of the same variance as a sine of 1 N·m, is that of another frequency.
    other = np.where(lost, np.sqrt(max(1 - level**2, 0)), 0.0)
    records = [
        SimpleNamespace(
            tau_Nm=(a * np.sin(2 * np.pi * f * time + 1) + b * np.sin(19 * np.pi * time))[:, None],
            start=0,
        )
        for a, b, f in zip(amplitude, other, frequency, strict=True)
    ]
    omega = 2 * np.pi * frequency
    q = 1 / omega[:, None] ** 2 + 0j  # rotors of 1 kg·m² need 1 N·m
    harmonics = np.stack([q, amplitude[:, None] + 0j], axis=2)
    covariance = np.zeros((4, 1, 2, 2))
    covariance[..., 1, 1] = noise**2
    phasors = case(
        n=1,
        omega=omega,
        q=q,
        harmonics=harmonics,
        harmonic_covariance=covariance,
        labels="abcd",
        frequency_found_hz=frequency,
        z=np.array([[moves, 1.0]] * 3 + [[1.0, 1.0]]),
        by_frequency=lambda: [(1.0, np.arange(4))],
    )
    given = case(
        phasors=phasors,
        inertias=[Inertia([inertia], [[1.0]])] * 4,
        fit=case(misfit=10.0 if poor else 9.9),
        sines=records,
        frequency_hz=frequency,
    )
    return list(rules_outlier.foreign_torques(given))


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"level": 0.39}, True),
        ({"level": 0.41}, False),  # above four times the noise
        ({"level": 0.3, "moves": 0.19}, False),  # held
        ({"level": 0.3, "moves": 0.21}, True),
        ({"level": 0.3, "inertia": 0.31}, False),  # a light rotor needs hardly any torque
        ({"level": 0.3, "inertia": 0.33}, True),
        ({"level": 0.3, "rows": (1, 2)}, False),  # a resonance
        ({"level": 0.3, "rows": (1, 2), "poor": True}, True),
        ({"level": 0.3, "rows": (0,), "poor": True}, False),  # a quarter of the records
        ({"level": 0.70, "noise": 1.0}, True),
        ({"level": 0.72, "noise": 1.0}, False),  # more than half of the torque's variance
    ],
)
def test_torques_that_lack_the_frequency_of_the_motion_are_foreign(
    settings: dict[str, Any], told: bool
) -> None:
    found = foreign(**settings)
    assert [f.title for f in found] == ["The torques do not belong to the motions"] * told
    for finding in found:
        assert finding.detail.startswith("In 2 of 4 records, the torque lacks the frequency of the")
        assert (finding.weight, finding.changes) == (103.0, ())


# --- responses


def peaks_of_controllers(height: float, **changes: Any) -> list[Any]:
    """Findings on a response with a peak at 3 Hz beside the resonance at 6 Hz, which H has."""
    hz = np.arange(1.0, 12.0)
    H = np.ones(hz.size)
    H[5] = 3.0
    response = np.column_stack([H, H])
    response[2, 1] = height
    settings = {"misfit": 99.0, "deviation": 0.1, "own": [6.0], "count": hz.size} | changes
    keep = slice(settings["count"])
    matrix = case(
        omega=2 * np.pi * hz[keep],
        H=(H[:, None, None] * np.ones((2, 2)))[keep],
        standard_deviation=np.full((hz[keep].size, 2, 2), settings["deviation"]),
    )
    phasors = case(
        by_frequency=lambda: [(w, np.array([k])) for k, w in enumerate(matrix.omega)],
        labels=[f"r{k}" for k in range(hz.size)],
    )
    phasors.select = lambda index: phasors
    fit = two_joints(misfit=settings["misfit"])
    fit.elasticity = None
    given = case(
        fit=fit,
        phasors=phasors,
        transfer_matrices={"": matrix},
        of_pose=lambda pose: (np.arange(hz.size), None),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rules_response, "resonances", lambda *_: np.array(settings["own"]))
        patch.setattr(rules_response, "single_record_response", lambda _: response[keep])
        return list(rules_response.foreign_peak(given))


def test_a_peak_that_h_lacks_is_that_of_the_controller() -> None:
    (found,) = peaks_of_controllers(1.5)
    assert found.title == "The peak of joint 2 at 3 Hz comes from the controller of joint 1"
    assert found.detail == (
        'In the single record "r2", acceleration over torque is 1.5 times H22, which has no peak at '
        "this frequency. The elastic resonance is the peak of H22 at 6 Hz."
    )
    assert (found.level, found.weight) == ("note", 0.3)
    for nothing in (
        peaks_of_controllers(1.3),
        peaks_of_controllers(1.5, misfit=101.0),
        peaks_of_controllers(1.5, deviation=0.201),
        peaks_of_controllers(1.5, own=[6.0, 2.1]),  # a resonance of the model beside it
        peaks_of_controllers(1.5, own=[1.0]),  # the peak of H is that of friction
        peaks_of_controllers(1.5, count=7),
    ):
        assert not nothing
    assert peaks_of_controllers(1.5, deviation=0.199)
    assert peaks_of_controllers(1.5, own=[6.9])
    assert peaks_of_controllers(1.5, own=[5.0])  # two lines from the peak


def test_the_share_of_the_angles_in_the_noise_of_the_residual() -> None:
    """Residual of 5q + 2τ − 3q, with τ of three times the variance: 4 of 4 + 12."""
    equations = case(
        omega=np.array([1.0, 2.0]),
        of_a=np.array([[[1.0, 0.0]]] * 2),
        of_b=np.array([[[5.0, 2.0]]] * 2),
        noise=case(covariance=np.tile(np.diag([1.0, 3.0]), (2, 1, 1, 1))),
    )
    fit: Any = case(n=1, K=np.array([3.0]), D=np.zeros(1), equations=equations)
    assert rules_model._share_of_angles(fit) == pytest.approx(0.25)
    assert peaks_of_controllers(1.5, count=8)


def test_frequencies_without_a_transfer_matrix_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    off: list[int] = []
    monkeypatch.setattr(rules_response, "off_frequency", lambda _: off)
    given = case(transfer_matrices={"": case(rejected=("At 3 Hz …",)), "far": case(rejected=())})
    (one,) = rules_response.rejected(given)
    assert (one.title, one.detail) == ("1 frequency has no transfer matrix", "At 3 Hz …")
    given.transfer_matrices["far"].rejected = ("b",)
    (two,) = rules_response.rejected(given)
    assert two.title == "2 frequencies have no transfer matrix"
    off.append(3)
    assert not list(rules_response.rejected(given))


# --- effects and causes, more


def effect(name: str, value: float, error: float, joint: int = 1) -> Any:
    return case(parameter=name, value=value, error=error, joints=(joint,), shown=(f"{value:g}", "s"))


def effects_of(
    monkeypatch: pytest.MonkeyPatch, found: dict[str, Any], alike: dict[str, str] | None = None
) -> list[Any]:
    monkeypatch.setattr(rules_effects, "contradicts", lambda fit: False)
    monkeypatch.setattr(rules_effects, "quantities", lambda fit: found)
    monkeypatch.setattr(rules_effects, "alternatives", lambda fit, name: alike or {})
    monkeypatch.setattr(rules_effects, "half_a_sample", lambda _: ("", []))
    monkeypatch.setattr(rules_effects, "second_amplitude", lambda _: "Measure at two amplitudes.")
    gears = [
        case(laws=("linear",), tried_Nm=1.5, backlash_share=0.1),
        case(laws=("backlash", "hardening"), tried_Nm=2.5, backlash_share=0.03),
    ]
    return list(rules_effects.effects_found(case(fit=two_joints(gears=gears))))


def test_effects_are_named_by_the_sign_of_the_clearest(monkeypatch: pytest.MonkeyPatch) -> None:
    for first, verb in ((3.0, "lag"), (-3.0, "lead")):
        lags = (effect("lag", first, 1.0), effect("lag", -2.0, 1.0, 2))
        (found,) = effects_of(monkeypatch, {"lag": lags, "K": lags})
        assert found.title == f"The torques {verb} by different amounts"
        assert f"{first:g} s (joint 1), -2 s (joint 2). The fit includes it." in found.detail
        assert found.remedy == "Check the sampling and output times of each drive."
        assert (found.level, found.weight) == ("note", 0.01)
    unknown = effect("lag", 3.0, 1.0)
    unknown.shown = ("not determined", "ms")
    (found,) = effects_of(monkeypatch, {"lag": (unknown,)})
    assert "Lag: not determined (joint 1)." in found.detail
    (other,) = effects_of(monkeypatch, {"lag": lags}, {"delay": "a delay", "link": "a link"})
    assert other.title == "The torques lead by different amounts, or there is a delay or a link"
    assert rules_causes.CANNOT_TELL in other.detail
    slopes = {"piecewise": "a gear with three slopes", "load": "load-dependent friction"}
    for size, verb in ((3.0, "hardens"), (-3.0, "softens")):
        (law,) = effects_of(monkeypatch, {"cubic": (effect("cubic", size, 1.0),)}, slopes)
        assert law.title == f"A gear {verb} or has three slopes, or there is load-dependent friction"
    (zero,) = effects_of(monkeypatch, {"lag": (effect("lag", -3.0, 0.0), effect("lag", 3.0, 1.0))})
    assert zero.title == "The torques lag by different amounts"  # without an error nothing is clear
    assert not effects_of(monkeypatch, {"lag": (effect("lag", -2.9, 1.0), effect("lag", 2.0, 1.0, 2))})


def test_laws_of_gears_are_those_of_the_gears_that_have_them(monkeypatch: pytest.MonkeyPatch) -> None:
    pair = {
        name: (effect(name, 1e-3, 1e-4), effect(name, 2e-3, 1e-4, 2)) for name in ("cubic", "backlash")
    }
    cubic, backlash = effects_of(monkeypatch, pair)
    assert cubic.title == "A gear hardens"
    assert cubic.remedy == (
        "K is the tangent stiffness at zero torque. Measure at the amplitude of the application. "
        "Largest torques of the gears in the records, at the motor: 1.5 N·m (joint 1) and 2.5 N·m "
        "(joint 2). Measure at two amplitudes."
    )
    assert "joint 1" not in backlash.detail
    assert "0.002 s at the motor (joint 2, 6.88 arcmin, 3.0 % of the peak-to-peak" in backlash.detail
    assert "Largest" not in backlash.remedy  # stated once
    monkeypatch.setattr(rules_effects, "contradicts", lambda fit: True)
    assert not list(rules_effects.effects_found(case(fit=two_joints())))


def test_friction_that_changes_between_records_is_noted_with_its_size(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    off = [False]
    monkeypatch.setattr(rules_effects, "contradicts", lambda fit: off[0])

    def found(change: Any, *, differs: bool = True, moves: bool = False) -> list[Any]:
        friction = change if change is None else case(change=np.array(change))
        candidates = [case(chosen=False, model=case(differs=True))]
        candidates.append(case(chosen=True, model=case(differs=differs)))
        phasors = case(motion=np.array([moves]))
        fit = two_joints(friction=friction, candidates=candidates, phasors=phasors)
        return list(rules_effects.friction_changes(case(fit=fit)))

    assert "its standard deviation is 0.02 N·m (joint 1). The" in found([0.02, 0.0])[0].detail
    (both,) = found([0.02, 0.03])
    assert both.level == "note"
    assert "0.02 N·m (joint 1) and 0.03 N·m (joint 2). The fit gives every record" in both.detail
    assert found(0.0, moves=True)[0].detail.startswith("The fit gives every segment of a motion")
    assert found(None) == found([0.02, 0.03], differs=False) == []
    off[0] = True
    assert found([0.02, 0.03]) == []


def test_gears_that_change_over_the_records_cause_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    """From the first to the last by the linear and the cubic part, whose errors are correlated."""
    layout = ParameterLayout.of(2, effects=["stiffness_change"])
    quadratic = np.array([0.005, 0.0])
    p = layout.named(
        layout.pack(
            stiffness_change=[-0.02, 0.03],
            stiffness_change_2=quadratic,
            stiffness_change_3=[0.005, 0.0],
        )
    )
    C = np.zeros((layout.size, layout.size))
    C[layout["stiffness_change"], layout["stiffness_change"]] = 4e-6 * np.eye(2)
    C[layout["stiffness_change_3"], layout["stiffness_change_3"]] = 4e-6 * np.eye(2)
    C[4, 8] = C[8, 4] = -3.5e-6
    off = [False]
    monkeypatch.setattr(rules_effects, "contradicts", lambda fit: off[0])

    def found(hz: list[float], *, moves: bool = False, poses: str = "", **parts: Any) -> list[Any]:
        phasors = case(omega=np.array(hz), progress=slow_changes(5))
        fit = two_joints(parameters=p, parameter_covariance=C, phasors=phasors, **parts)
        return list(rules_effects.gears_change(case(fit=fit, has_motions=moves, poses=tuple(poses))))

    (only,) = found([3.0, 2.0, 4.0])
    assert only.level == "warning"
    assert only.title == "The stiffness of the gears changes over the records"
    assert only.detail == (
        "From the first record to the last it changes by −1.50 ± 0.10 % (joint 1) and 3.0 ± 0.3 % "
        "(joint 2). K is its mean."
    )
    assert only.remedy == "Warm the robot up before the experiment."
    assert only.weight == pytest.approx(10.03)
    (ordered,) = found([2.0, 3.0, 3.0])
    assert ordered.detail.endswith("in order of frequency: stiffness that depends on it looks the same.")
    assert "random order" in ordered.remedy
    assert "random order" not in found([2.0, 3.0], moves=True)[0].remedy
    (in_turn,) = found([3.0, 2.0, 4.0], poses="aabb")
    assert in_turn.detail.endswith(
        "one after another: stiffness that depends on the pose looks the same."
    )
    assert in_turn.remedy.endswith("experiment, and return to the first pose at the end.")
    for poses in ("aaa", "aabba"):
        assert found([3.0, 2.0, 4.0], poses=poses) == [only]
    p.vector[layout["stiffness_change_2"]] = [0.08, 0.0]  # K rises and falls back, by 3/4 of it
    (bulge,) = found([3.0, 2.0, 4.0])
    assert (
        "−1.50 ± 0.10 % (joint 1) and 3.0 ± 0.3 % (joint 2). In between, it varies by up to"
        in bulge.detail
    )
    assert bulge.detail.endswith("% (joint 1). K is its mean.")
    assert bulge.weight == pytest.approx(10.067, abs=1e-3)
    p.vector[layout["stiffness_change_2"]] = quadratic
    off[0] = True
    assert not found([2.0, 3.0])


def against(monkeypatch: pytest.MonkeyPatch, off: float, **parts: Any) -> list[Any]:
    """Findings where the paper's estimate of K2 differs by a relative ``off``."""
    fit = two_joints(gears=(), torque_scale=1.0, inertias=(), **parts)
    other = fit.estimate * [1 + off / 2, 1 + off, 1, 1]
    paper = case(elasticity=other, elasticity_covariance=np.diag(parts.get("paper", 0.0) * other**2))
    monkeypatch.setattr(rules_causes, "least_squares", lambda _: paper)
    monkeypatch.setattr(rules_causes, "spring_equations", lambda *_: None)
    monkeypatch.setattr(rules_causes, "replace", lambda logged, **_: logged)
    given = case(fit=fit, phasors=case(tau=np.ones(1)), records=[case(interval_s=1e-3)])
    return list(rules_causes.against_the_paper(given))


def test_a_difference_from_the_paper_has_a_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    fine = {"standard_error": 1e-3 * two_joints().estimate}
    (found,) = against(monkeypatch, 0.01, **fine)
    assert found.title == "Noise biases the paper's least squares: it gives K2 1.0 % too high"
    assert found.detail.endswith("least squares also gives K1 0.50 % too high.")
    assert found.weight == pytest.approx(0.01)
    assert found.remedy.startswith("No action needed: the chosen estimator")
    (low,) = against(monkeypatch, -0.007, **fine)
    assert low.title.endswith("K2 0.70 % too low")
    assert low.detail == "Both fits use the same inertias."
    friction = case(coulomb=np.array([0.1, 0.02]), viscous=np.array([3.0, 4.0]))
    (rubs,) = against(monkeypatch, 0.01, friction=friction, **fine)
    assert rubs.title == "Friction matters: the paper's least squares gives K2 1.0 % too high"
    assert "Viscous friction is 3 and 4 N·m·s/rad; the fit includes it." in rubs.detail
    assert rubs.remedy.startswith("No action needed. Larger motions")
    late = {"delay": -4e-4, "delay_error": 1e-5}
    (both,) = against(monkeypatch, 0.01, friction=friction, **late, **fine)
    assert both.title.startswith("Friction and a torque lead matter: ")
    assert "the torque leads by 0.4 ms; the fit includes both" in both.detail
    assert both.remedy.startswith("Larger motions")
    layout = {"parameters": case(layout={"coulomb": 0}), "errors": {"coulomb": np.full(2, 0.01)}}
    (slides,) = against(monkeypatch, 0.01, friction=friction, **layout, **fine)
    assert "Coulomb friction is 0.1 and 0.02 N·m; the fit includes it." in slides.detail
    friction.coulomb = np.array([0.1, -0.009])
    assert against(monkeypatch, 0.01, friction=friction, **layout, **fine)
    friction.coulomb = np.array([0.1, -0.011])  # friction dissipates energy
    assert not against(monkeypatch, 0.01, friction=friction, **layout, **fine)
    for nothing in (
        against(monkeypatch, 0.0039, **fine),  # within four errors
        against(monkeypatch, 0.0019, standard_error=1e-9 * two_joints().estimate),
        against(monkeypatch, 0.01, paper=0.003**2, **fine),
        against(monkeypatch, 0.01, method="least-squares", **fine),
        against(monkeypatch, 0.01, misfit=3.1, **fine),
        against(monkeypatch, 0.01, **late, **fine),
        against(monkeypatch, 0.01, estimate=np.array([20.0, -4.0, 0.1, 0.02]), **fine),
    ):
        assert not nothing
    assert against(monkeypatch, 0.0041, **fine)
    assert against(monkeypatch, 0.0021, standard_error=1e-9 * two_joints().estimate)
    assert against(monkeypatch, 0.01, misfit=2.9, **fine)


def lagging(monkeypatch: pytest.MonkeyPatch, delay: float, of_K2: float, **parts: Any) -> list[Any]:
    """Findings on a torque delay that would shift K2 by a relative ``of_K2`` if it were not fitted."""
    error = 1e-5
    covariance = np.zeros((5, 5))
    covariance[4, 4] = error**2
    covariance[1, 4] = covariance[4, 1] = -of_K2 * 4.0 * error**2 / delay
    parameters = case(layout={"delay": slice(4, 5)})
    fit = two_joints(delay=delay, delay_error=error, parameters=parameters, candidates=())
    fit.parameter_covariance = covariance
    monkeypatch.setattr(rules_causes, "half_a_sample", lambda _: parts.get("hold", ("", [])))
    monkeypatch.setattr(rules_causes, "alternatives", lambda *_: parts.get("alike", {}))
    given = case(fit=fit, records=[case(interval_s=1e-3)])
    return list(rules_causes.torque_lags(given))


def test_a_lag_is_reported_where_it_changes_the_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """By more than one standard error, one per cent here."""
    assert not lagging(monkeypatch, 5e-4, 0.0099)
    (found,) = lagging(monkeypatch, 5e-4, 0.0101)
    assert found.title == "The torque lags by 0.5 ms"
    assert found.detail == (
        "The lag is 0.500 ± 0.010 samples; the fit includes it. If it were ignored, K2 would be about "
        "1.0 % too high."
    )
    assert "add 0.5 ms to the torque's delay on import, or 0.0005 s to torque_delay_s" in found.remedy
    assert (found.level, found.action) == ("note", "edit mapping")
    assert found.weight == pytest.approx(0.0101)
    assert [(c.kind, c.values) for c in found.changes] == [("delay", (5e-4,))]
    (leads,) = lagging(monkeypatch, -5e-4, -0.02, alike={"lag": "a lag"}, hold=("Hold.", ["change"]))
    assert leads.title == "The torque leads by 0.5 ms, or there is a lag"
    assert leads.detail.startswith("The records cannot distinguish these. The lead is 0.500")
    assert leads.detail.endswith("K2 would be about 2.0 % too low.")
    assert (leads.remedy, leads.changes) == ("Hold.", ("change",))
    assert lagging(monkeypatch, 5e-4, -1.01)[0].detail.endswith("K2 would be negative.")
    assert lagging(monkeypatch, 5e-4, -0.99)[0].detail.endswith("K2 would be about 99 % too low.")
    assert lagging(monkeypatch, 5e-4, 11.0)[0].detail.endswith("be more than 1000 % too high.")


@pytest.mark.parametrize(("softer", "told"), [(0.0099, []), (0.0101, ["note"])])
def test_an_uncoupled_joint_does_not_separate_gear_and_link(softer: float, told: list[str]) -> None:
    """A typical link makes K 1 % lower, which is the standard error here."""
    M2 = np.diag([2.0, 3.0])
    fit = two_joints()
    fit.prior = case(link_std=lambda K, usual: softer * np.diag(M2) ** 2 / K)
    given = case(fit=fit, inertias=[Inertia([0.1, 0.1], M2)])
    found = list(rules_model.link_in_series(given))
    assert levels(found) == told * 2
    for j, finding in enumerate(found, 1):
        assert finding.title == f"K{j} is the stiffness of gear and link in series"
        assert f"makes K{j} 1.0 % lower" in finding.detail
    M2[0, 1] = M2[1, 0] = 0.1
    given.inertias = [Inertia([0.1, 0.1], M2)]
    assert not list(rules_model.link_in_series(given))


# --- inertias, more


def axes(
    monkeypatch: pytest.MonkeyPatch, misfits: list[float], after: float, *, before: float, misfit: float
) -> list[Any]:
    """Findings where hypotheses leave these misfits, and a whole fit is ``after`` from the priors."""
    other = two_joints(misfit=1.0)
    fit = two_joints(misfit=misfit, prior=case(like=lambda inertias, shape: inertias))
    off = {id(fit): before, id(other): after}
    monkeypatch.setattr(rules_inertia, "motion_misfits", lambda *_: np.array(misfits))
    monkeypatch.setattr(rules_inertia, "_refitted", lambda *_: other)
    monkeypatch.setattr(rules_inertia, "disagreements", lambda of: np.array([0.0, off[id(of)]]))
    inertias = [Inertia([1.0, 2.0], [[3.0, 0.5], [0.5, 4.0]])]
    given = case(fit=fit, inertias=inertias, records=(), has_motions=True, phasors=None)
    return list(rules_inertia.axes_exchanged(given))


def test_axes_are_exchanged_or_reversed_where_a_fit_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """The hypotheses: as given, reversed, exchanged, both."""
    (found,) = axes(monkeypatch, [100.0, 69.0, 90, 90], 2.0, before=5.0, misfit=100.0)
    assert found.title == "Joint 1 or joint 2 looks reversed relative to the other"
    assert found.detail == (
        "Residual as given: 10 × noise with inertias up to 5 standard deviations from the given ones; "
        "corrected: 1.0 × noise with inertias up to 2 standard deviations from the given ones."
    )
    (swapped,) = axes(monkeypatch, [100.0, 69.0, 60, 90], 2.0, before=0.0, misfit=100.0)
    assert swapped.title == "The inertias of joints 1 and 2 look swapped"
    assert swapped.detail == "Residual as given: 10 × noise; corrected: 1.0 × noise."
    for misfits, after, before, misfit, told in (
        ([100.0, 71.0, 90, 90], 2.0, 5.0, 100.0, False),
        ([100.0, 69.0, 90, 90], 3.9, 5.0, 100.0, True),
        ([100.0, 69.0, 90, 90], 4.1, 5.0, 100.0, False),
        ([100.0, 69.0, 90, 90], 2.4, 5.0, 2.9, True),  # a fit that explains the data as well
        ([100.0, 69.0, 90, 90], 2.6, 5.0, 2.9, False),
        ([100.0, 69.0, 90, 90], 4.1, 9.0, 2.9, False),
    ):
        found_all = axes(monkeypatch, misfits, after, before=before, misfit=misfit)
        assert bool(found_all) == told, (misfits, after, before, misfit)


@pytest.mark.parametrize(
    ("fitted", "error", "told"),
    [
        ([2.1, 1.0], 0.1, True),
        ([1.9, 1.0], 0.1, False),  # start values lie within 50 %
        ([2.1, 1.0], 0.21, False),  # the fitted inertias are not known
        ([4.1, 4.1], 0.1, False),  # exchanging them does not help
        ([2.1, 1.57], 0.1, False),  # nor does it by more than half
    ],
)
def test_start_values_are_exchanged_where_the_fit_is_near_the_others(
    fitted: list[float], error: float, told: bool
) -> None:
    """Given 1 and 2 for the joints, fitted 2 and 1."""
    given = Inertia([1.0, fitted[0]], np.diag([1.0, fitted[0]]))
    own = two_joints(prior=case(inertia_std=np.inf))
    own.inertias = [Inertia(fitted, np.diag(fitted))]
    own.parameters = type("P", (dict,), {"layout": {"M": 0}})(M=np.ones(2))
    own.errors = {"M": np.array([0.0, error])}
    found = list(rules_inertia._starts_exchanged(case(inertias=[given]), own))
    assert [f.title for f in found] == ["The inertias of joints 1 and 2 look swapped"] * told
    for finding in found:
        assert finding.detail.startswith(
            "The fitted inertias differ from the start values by factors of up to 2.1 as given, and up "
            "to 1.0 with these joints swapped."
        )
    own.prior.inertia_std = 0.3
    assert not list(rules_inertia._starts_exchanged(case(inertias=[given]), own))


# --- all rules together


def order_of(
    monkeypatch: pytest.MonkeyPatch,
    *,
    outlier: int | None = None,
    off: tuple[int, ...] = (),
    **found: Any,
) -> list[str]:
    """Titles in the verdict where these rules have findings, of a level by their first letter."""
    make = {"p": evidence.problem, "w": evidence.warning, "n": evidence.note}

    def rule(name: str) -> Any:
        texts = found.get(name, ())
        return lambda *_: iter([make[text[0]](text, "", "", 0.0) for text in texts])

    for name in ("foreign_torques", "motors_take_power", "inertias_look_wrong", "poses_disagree"):
        monkeypatch.setattr(findings, name, rule(name))
    for name in ("depends_on_amplitude", "one_frequency", "joints_apart"):
        monkeypatch.setattr(findings, name, rule(name))
    monkeypatch.setattr(findings, "wrong_columns", lambda *_: tuple(rule("wrong_columns")()))
    monkeypatch.setattr(findings, "of_records", lambda _: [*rule("records")()])
    monkeypatch.setattr(findings, "fitted_parts", lambda _: [])
    for name in ("_OF_THE_ANSWER", "_OF_ITS_PRECISION"):
        monkeypatch.setattr(findings, name, (rule(name),))
    monkeypatch.setattr(findings, "off_frequency", lambda _: off)
    one = None if outlier is None else (outlier, evidence.problem("p off", "", "", 9.0))
    monkeypatch.setattr(findings, "one_record_off", lambda _: one)
    fit = two_joints(misfit=found.get("misfit", 1.0))
    given = evidence.Evidence((), (), case(), fit, {})  # type: ignore[arg-type]
    return [each.title for each in findings.findings(given)]


def test_findings_on_the_answer_require_right_data(monkeypatch: pytest.MonkeyPatch) -> None:
    every = {
        "records": ["w record"],
        "one_frequency": ["n one"],
        "_OF_THE_ANSWER": ["n answer"],
        "_OF_ITS_PRECISION": ["w precise", "p limits"],
    }
    fine = "The model explains the data"
    assert order_of(monkeypatch) == [fine]
    assert order_of(monkeypatch, _OF_THE_ANSWER=["n answer"]) == [fine, "n answer"]
    assert order_of(monkeypatch, **every) == ["p limits", "w record", "w precise", "n one", "n answer"]
    assert order_of(monkeypatch, poses_disagree=["w poses"], **every) == [
        "p limits", "w record", "w poses", "n one", "n answer",
    ]  # fmt: skip
    wrong = order_of(monkeypatch, inertias_look_wrong=["w inertias"], poses_disagree=["w p"], **every)
    assert wrong == ["w record", "w inertias", "n one", "n answer"]
    assert order_of(monkeypatch, outlier=3, **every) == ["p off", "w record", "n one"]
    # No single record explains wrong columns, which are quicker to find.
    assert order_of(monkeypatch, outlier=3, wrong_columns=["p columns"], **every)[0] == "p columns"
    assert order_of(monkeypatch, outlier=3, off=(3,), **every) == ["w record", "n one"]
    columns = order_of(monkeypatch, wrong_columns=["p columns"], motors_take_power=["p no"], **every)
    assert columns == ["p columns", "w record"]  # a note on wrong data may mislead
    apart = order_of(monkeypatch, joints_apart=["p apart"], motors_take_power=["p no"], **every)
    assert apart == ["p apart", "w record"]
    foreign = order_of(monkeypatch, foreign_torques=["p foreign"], outlier=3, **every)
    assert foreign == ["p foreign", "w record"]
    for misfit, told in ((9.9, False), (10.0, True)):
        power = order_of(monkeypatch, motors_take_power=["p power"], misfit=misfit)
        assert power == (["p power"] if told else [fine])


def test_the_rules_judge_the_best_model(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fit of "auto" where the chosen one does not explain the data, and it does."""
    best = two_joints(misfit=9.9)
    asked = []

    def identify(*_: Any) -> Any:
        asked.append(1)
        return {"auto": best}

    monkeypatch.setattr(findings, "identify_each", identify)

    def judged(fit: Any, automatic: Any = None) -> Any:
        return findings._best_fit(evidence.Evidence((), (), case(), fit, {}, automatic))  # type: ignore[arg-type]

    poor = two_joints(misfit=10.0, method="weighted", candidates=())
    assert judged(poor) is best
    assert judged(poor, automatic=two_joints(misfit=11.0)) is poor
    assert judged(poor, automatic=(known := two_joints(misfit=9.9))) is known
    for fit in (
        two_joints(misfit=9.9, method="weighted", candidates=()),
        two_joints(misfit=10.0),
        two_joints(misfit=10.0, method="weighted", candidates=(1,)),
    ):
        assert judged(fit) is fit
    negative = two_joints(estimate=np.array([20.0, 4.0, 0.1, -0.02]), method="weighted", candidates=())
    assert judged(negative) is best
    assert len(asked) == 2


@pytest.mark.parametrize(
    ("misfit", "off", "wrong"),
    [(9.9, 3.9, False), (9.9, 4.1, True), (10.0, 0.0, True)],
)
def test_columns_may_be_wrong_where_the_fit_is_far_off(
    monkeypatch: pytest.MonkeyPatch, misfit: float, off: float, wrong: bool
) -> None:
    monkeypatch.setattr(findings, "disagreements", lambda fit: np.array([0.0, off]))
    assert findings.may_be_wrong(case(fit=two_joints(misfit=misfit))) == wrong


# --- motions, more


def of_motion(
    monkeypatch: pytest.MonkeyPatch, rest: float = 0.0, off: bool = False, **found: Any
) -> list[str]:
    """Titles in the verdict on a study with a motion."""
    make = {"p": evidence.problem, "w": evidence.warning, "n": evidence.note}

    def rule(name: str) -> Any:
        return lambda *_: iter([make[t[0]](t, "", "", 0.0) for t in found.get(name, ())])

    names = ("not_physical", "counted_twice", "axes_exchanged", "inertias_contradict", "effects_found")
    for name in (*names, "torque_lags", "model_limits", "hardly_tested", "hardly_known", "of_records"):
        monkeypatch.setattr(motion_findings, name, rule(name))
    for name in (
        "wrong_data",
        "joints_apart",
        "beyond_logged_noise",
        "friction_changes",
        "gears_change",
        "_joints_at_rest",
    ):
        monkeypatch.setattr(motion_findings, name, rule(name))
    monkeypatch.setattr(findings, "fitted_parts", lambda _: [])
    monkeypatch.setattr(motion_findings, "_responses", lambda *_: ((), ()))
    monkeypatch.setattr(motion_findings, "share_at_rest", lambda _: np.array([0.0, rest]))
    monkeypatch.setattr(motion_findings, "may_be_wrong", lambda _: off)
    monkeypatch.setattr(motion_findings, "judged", lambda _: found.get("own"))
    time = np.arange(16) / 10
    record = MotionRecord(time, np.ones((16, 2)), np.ones((16, 2)))
    fit = two_joints(phasors=case())
    phasors = case(select=lambda _: case())
    inertia = Inertia([0.1, 0.1], np.eye(2))
    fits = {"auto": fit} | ({"weighted": fit} if "of_records" in found else {})
    told = motion_findings.motion_findings(
        [record], [inertia], phasors, fits, {"": case()} if found.get("matrices", True) else {}
    )  # type: ignore[arg-type]
    return [each.title for each in told]


def test_findings_on_motions_require_right_data(monkeypatch: pytest.MonkeyPatch) -> None:
    doubts = {"model_limits": ["w limits"], "hardly_tested": ["w tested"], "hardly_known": ["w known"]}
    fine = "The model explains the data"
    assert of_motion(monkeypatch, effects_found=["n effect"]) == [fine, "n effect"]
    assert of_motion(monkeypatch, **doubts) == ["w limits", "w tested", "w known"]
    resting = of_motion(monkeypatch, _joints_at_rest=["w rest"], **doubts)
    assert resting == ["w rest", "w limits", "w tested"]
    wrong = {"wrong_data": ["p units"], "axes_exchanged": ["p axes"], **doubts}
    assert of_motion(monkeypatch, off=True, own=1, inertias_contradict=["w no"], **wrong) == ["p units"]
    assert of_motion(monkeypatch, off=True, rest=0.34, **wrong) == ["p units"]
    assert of_motion(monkeypatch, off=True, rest=0.36, **wrong) == ["p axes"]
    assert of_motion(monkeypatch, off=True, matrices=False, **wrong) == ["p axes"]
    inertias = of_motion(monkeypatch, own=1, inertias_contradict=["w inertias"], **doubts)
    assert inertias == ["w inertias"]
    assert of_motion(monkeypatch, inertias_contradict=["w no"]) == [fine]  # no fit of their own
    assert of_motion(monkeypatch, off=True, joints_apart=["p apart"], **doubts) == ["p apart"]
    beyond = of_motion(monkeypatch, beyond_logged_noise=["w beyond"])
    assert beyond == ["w beyond"]
    sines = of_motion(monkeypatch, of_records=["w record"], not_physical=["p K"], counted_twice=["n 2"])
    assert sines == ["p K", "w record", "n 2"]
