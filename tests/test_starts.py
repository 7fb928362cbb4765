"""Start values of the estimators on phasors of robots with known parameters."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plants import BAND_HZ, ROBOTS, campaign, circular, exact_phasors, noisy, plant_phasors

from jointid import Elasticity, Inertia, JointIdError
from jointid.estimation import model_fits, model_growth
from jointid.estimation.candidates import Model
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.joint_equations import spring_equations
from jointid.estimation.estimators.linear_fit import _least_squares, without_inertias
from jointid.estimation.estimators.parameters import ParameterLayout
from jointid.estimation.estimators.problem import Problem
from jointid.estimation.model_growth import _is_passed_over, grown
from jointid.estimation.model_selection import _given_up
from jointid.estimation.regression_start import regressed, regression_start
from jointid.estimation.start_values import (
    _largest_torque,
    at_resonances,
    by_motion,
    other_laws,
    with_delay,
)
from jointid.joints import motor_impedance
from jointid.motion.friction import friction_waveforms


@pytest.mark.parametrize("n", [1, 2, 3])
def test_torque_over_deflection_starts_at_the_stiffness(n: int) -> None:
    """K is exact without damping, and damping turns the torque by a right angle."""
    inertia, elasticity = ROBOTS[n]
    phasors = plant_phasors(inertia, elasticity, *campaign(BAND_HZ, n))
    start = by_motion(phasors, InertiaPrior.of(inertia, *phasors.q.shape))
    np.testing.assert_allclose(start.K, elasticity.K, rtol=1e-6)
    np.testing.assert_allclose(start.D, 0.1 * start.K / phasors.omega.max(), rtol=1e-9)
    torque = phasors.tau + phasors.omega[:, None] ** 2 * inertia.M * phasors.q
    delta = torque / (elasticity.K + 1j * phasors.omega[:, None] * elasticity.D)
    for name, values in (("hysteresis", torque), ("presliding", delta)):
        np.testing.assert_allclose(start[name], 0.1 * np.abs(values).max(axis=0), rtol=1e-6)


def test_other_starts_resonate_at_frequencies_of_the_records() -> None:
    inertia, elasticity = ROBOTS[2]
    phasors = plant_phasors(inertia, elasticity, *campaign(BAND_HZ, 2))
    prior = InertiaPrior.of(inertia, *phasors.q.shape)
    for start, hertz in zip(at_resonances(phasors, prior), BAND_HZ[[3, 6, 0]], strict=True):
        omega = 2 * np.pi * hertz
        np.testing.assert_allclose(start.K, np.diag(inertia.M2) * omega**2)
        np.testing.assert_allclose(start.D, 0.05 * start.K / omega)
        assert "coulomb" not in start.layout
    layout = ParameterLayout.of(2, friction=True)
    rubbing = layout.named(layout.pack(K=[1, 1], D=[1, 1], coulomb=[0.3, 0.2], viscous=[0.1, 0.4]))
    for start in at_resonances(phasors, prior, friction=rubbing):
        assert [*start["coulomb"], *start["viscous"]] == [0.3, 0.2, 0.1, 0.4]


@pytest.mark.parametrize("n", [1, 2, 3])
def test_inertias_follow_from_the_records_where_they_are_physical(n: int) -> None:
    inertia, elasticity = ROBOTS[n]
    phasors = plant_phasors(inertia, elasticity, *campaign(BAND_HZ, n))
    prior = InertiaPrior.of(inertia, *phasors.q.shape)
    start = without_inertias(phasors, prior)
    assert start is not None
    np.testing.assert_allclose(start.K, elasticity.K, rtol=1e-6)
    np.testing.assert_allclose(start["M"].ravel(), inertia.M, rtol=1e-6)
    np.testing.assert_allclose(prior.symmetric(start["M2"])[0], inertia.M2, rtol=1e-6)
    least, most = 0.005 * start.K / phasors.omega.max(), start.K / phasors.omega.min()
    np.testing.assert_allclose(start.D, np.clip(elasticity.D, least, most), rtol=1e-6)
    assert without_inertias(replace(phasors, tau=-phasors.tau), prior) is None
    equations = (4 * n + 2) // 2  # of as many real numbers as unknowns and more
    few = phasors.select(np.arange(phasors.omega.size) < equations - 1)
    assert without_inertias(few, prior) is None


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("rubs", [False, True])
def test_the_equation_of_the_arm_gives_stiffness_friction_and_payload(n: int, rubs: bool) -> None:
    """Exactly; the payload also loads the arm by gravity. The misfit grows with unstated noise."""
    inertia, elasticity = ROBOTS[n]
    shared, weight = 0.2 * inertia.M2, 0.5 * np.eye(n)
    loaded = Inertia(inertia.M, inertia.M2 + 0.7 * shared, gravity=0.7 * weight)
    phasors = plant_phasors(loaded, elasticity, *campaign(BAND_HZ, n))
    waves = friction_waveforms(phasors, None).coulomb[:, 0]
    s, levels = 1j * phasors.omega[:, None], np.array([0.05, 0.02, 0.03])[:n]
    tau = phasors.tau + rubs * (levels * waves + 0.2 * levels * s * phasors.q)
    phasors = replace(phasors, tau=tau, harmonics=np.zeros(0))
    given = Inertia(inertia.M, inertia.M2, shared=shared, shared_gravity=weight)
    prior = InertiaPrior.of(given, *phasors.q.shape)
    start, misfit = regressed(phasors, prior)
    np.testing.assert_allclose(start.K, elasticity.K, rtol=1e-6)
    np.testing.assert_allclose(start.D, elasticity.D, rtol=1e-5)
    np.testing.assert_allclose(prior.symmetric(start["M2"])[0], loaded.M2, rtol=1e-6)
    assert ("coulomb" in start.layout) == rubs
    if rubs:
        np.testing.assert_allclose(start["coulomb"], levels, rtol=1e-5)
        np.testing.assert_allclose(start["viscous"], 0.2 * levels, rtol=1e-5)
    assert misfit == 1.0
    rng, variance = np.random.default_rng(n), np.full(2 * n, 1e-10) * np.abs(phasors.z).max(axis=0) ** 2
    stated = np.tile(np.diag(variance).astype(complex), (len(phasors.q), 1, 1))
    error = circular(rng, stated, 1)[0]
    misfits = [regressed(noisy(phasors, stated, size * error), prior)[1] for size in (3, 6)]
    assert misfits[1] / misfits[0] == pytest.approx(4.0, rel=0.25)
    assert 1.2 < misfits[0] < 4.5  # rows are real and imaginary parts, with half of the variance each


@pytest.mark.parametrize("n", [1, 3])
@pytest.mark.parametrize("late_s", [0.0, 3e-3])
def test_the_equation_of_the_arm_gives_gravity_beside_a_delay(n: int, late_s: float) -> None:
    """Exactly; a torque that acts before it is logged is no delay."""
    inertia, elasticity = ROBOTS[n]
    weight = np.array([1.5, -0.4, 0.8])[:n]
    hanging = Inertia(inertia.M, inertia.M2, gravity=np.diag(weight))
    phasors = plant_phasors(hanging, elasticity, *campaign(BAND_HZ, n))
    logged = phasors.tau * np.exp(1j * phasors.omega[:, None] * late_s)
    phasors = exact_phasors(phasors.frequency_found_hz, phasors.q, logged)
    prior = InertiaPrior.of(inertia, *phasors.q.shape)
    start, misfit = regressed(phasors, prior, hangs=True, lags=late_s > 0)
    np.testing.assert_allclose(start.K, elasticity.K, rtol=1e-6)
    np.testing.assert_allclose(start.D, elasticity.D, rtol=1e-4)
    np.testing.assert_allclose(start["gravity"], weight, rtol=1e-4)
    assert misfit == 1.0
    turned = np.exp(-2j * phasors.omega[:, None] * late_s)
    early = exact_phasors(phasors.frequency_found_hz, phasors.q, logged * turned)
    assert late_s == 0 or regressed(early, prior, hangs=True, lags=True)[1] > 2


@pytest.mark.parametrize("always", [2, None])
def test_torques_of_held_joints_are_eliminated(always: int | None) -> None:
    """Friction that holds a motor takes any torque; the arm still moves against the gear.

    Where the joint is held in all records, the coupling of the arm shows its stiffness.
    """
    inertia, elasticity = ROBOTS[3]
    moved = plant_phasors(inertia, elasticity, *campaign(BAND_HZ, 3))
    held = np.arange(len(moved.q))[:, None] % 3 == np.arange(3)  # each in a third of the records
    held = held if always is None else np.arange(3) == np.full((len(moved.q), 1), always)
    q = np.where(held, 0, moved.q)
    s = 1j * moved.omega
    tau = (
        motor_impedance(s, inertia.M, np.linalg.inv(inertia.M2), elasticity.K, elasticity.D)[0]
        @ q[..., None]
    )[..., 0]
    tau += held * np.abs(tau).max()
    phasors = exact_phasors(moved.frequency_found_hz, q, tau)
    prior = InertiaPrior.of(inertia, *phasors.q.shape)
    start, _ = regressed(phasors, prior, stiff=0.0)
    np.testing.assert_allclose(start.K, elasticity.K, rtol=1e-4)
    np.testing.assert_allclose(start.D, elasticity.D, rtol=1e-2)
    assert "coulomb" not in start.layout


@pytest.mark.parametrize(
    ("misfits", "fits", "chosen"),
    [
        ([900.0, 1.2], 2, 1.2),  # near
        ([900.0, 30.0, 7.0, 50.0, 7.05], 5, 7.0),  # the same minimum again
        ([900.0, 30.0, 7.0, 50.0, 8.0], 5, 7.0),
    ],
)
def test_held_joints_are_fitted_from_several_starts(
    monkeypatch: pytest.MonkeyPatch, misfits: list[float], fits: int, chosen: float
) -> None:
    """Until a fit is near, or the best one is found again."""
    found = [
        SimpleNamespace(misfit=each, whole_cost=lambda _, each=each: each, named=each)
        for each in misfits
    ]
    asked = iter(found)
    monkeypatch.setattr(model_fits, "fit_model", lambda *_: next(asked))
    monkeypatch.setattr(model_fits, "regressed", lambda *_, stiff: (stiff, 1.0))
    phasors: Any = SimpleNamespace(n=3)
    anything: Any = None
    start: Any = "start"
    best: Any = model_fits._start_with_held(phasors, anything, anything, start, anything, anything)
    assert best == chosen
    assert len(list(asked)) == len(misfits) - fits


def test_a_joint_that_friction_holds_may_lose_all_torque() -> None:
    """The wind-up of its gear is then within the noise in all records."""
    inertia, elasticity = ROBOTS[2]
    phasors = plant_phasors(inertia, elasticity, *campaign(BAND_HZ, 2))
    variance = 10 * np.abs(phasors.z).max(axis=0) ** 2
    stated = np.tile(np.diag(variance).astype(complex), (len(phasors.q), 1, 1))
    phasors = noisy(phasors, stated, np.zeros((len(phasors.q), 4)))
    for joint, rests in ((1, [False, True]), (2, [True, False])):
        with pytest.raises(JointIdError, match=f"Joint {joint} is not excited"):
            spring_equations(phasors, inertia, rests=np.array(rests))
    assert spring_equations(phasors, inertia, rests=np.array([True, True])).a.shape == phasors.q.shape


def test_undetermined_equations_have_no_solution() -> None:
    rng = np.random.default_rng(1)
    A = (rng.standard_normal((9, 3)) + 1j * rng.standard_normal((9, 3))) * [1, 1e-6, 1e6]
    x = np.array([2.0, -1e6, 1e-6])
    found = _least_squares(A, A @ x)
    assert found is not None
    np.testing.assert_allclose(found, x, rtol=1e-6)
    assert _least_squares(A * [1, 1, 0], A @ x) is None
    assert _least_squares(np.column_stack([A, A[:, 0] + A[:, 1]]), A @ x) is None


def test_heavy_friction_is_found_with_k_and_d() -> None:
    """Two thirds of the smallest torque brake the motors: without friction K starts far off."""
    inertia, elasticity = ROBOTS[2]
    elasticity = Elasticity(elasticity.K, 0.02 * elasticity.K / 30)
    phasors = plant_phasors(inertia, elasticity, *campaign(BAND_HZ, 2))
    braked = np.array([0.5, 0.4])
    motion = phasors.q[:, :2]
    friction = friction_waveforms(phasors, None).coulomb[:, 0] * braked
    friction = friction + 1j * phasors.omega[:, None] * motion * [2e-3, 1e-3]
    rubbed = exact_phasors(phasors.frequency_found_hz, phasors.q, phasors.tau + friction)
    prior = InertiaPrior.of(inertia, *phasors.q.shape)
    start = regression_start(rubbed, prior)
    np.testing.assert_allclose(start.K, elasticity.K, rtol=1e-3)
    np.testing.assert_allclose(start["coulomb"], braked, rtol=1e-3)
    assert "coulomb" not in regression_start(phasors, prior).layout


@pytest.mark.parametrize("is_near", [True, False])
def test_slopes_start_with_bends_at_shares_of_the_largest_deflection(is_near: bool) -> None:
    """That of the cubic law where it is near the data, else that of the linear gear."""
    inertia, elasticity = ROBOTS[1]
    phasors = plant_phasors(inertia, elasticity, *campaign(BAND_HZ, 1))
    peak = np.abs(phasors.tau + phasors.omega[:, None] ** 2 * inertia.M * phasors.q).max()
    cubic, slopes = (ParameterLayout.of(1, effects=[law]) for law in ("cubic", "piecewise"))
    start = cubic.named(cubic.pack(K=[30.0], D=[0.1], cubic=[2e4]))
    p = slopes.named(slopes.pack(K=[40.0], D=[0.1], knee=[1.0], second_knee=[1.0]))
    prior = InertiaPrior.of(inertia, *phasors.q.shape)
    found = other_laws(phasors, prior, start, p, is_near=is_near)
    largest = found[0]["knee"][0] / 0.5
    torque = 30 * largest + 2e4 * largest**3 * is_near
    assert torque == pytest.approx(peak, rel=0.01)
    knees = [(each["knee"][0], each["second_knee"][0]) for each in found]
    np.testing.assert_allclose(knees, largest * np.array([[0.5, 0.3], [0.2, 0.3]]))
    assert all((each.K[0], each["cubic"][0]) == (30.0, 2e4) for each in found)


@pytest.mark.parametrize(
    ("hysteresis", "presliding", "found"),
    [
        (0.05, 0.31, (0.03, 0.03)),  # as wide as the deflection: a spring beside K
        (0.05, 0.29, None),
        (0.05, 1.9e-3, (0.05, 0.03)),  # without width: friction
        (0.05, 2.1e-3, None),
        (1.9e-3, 0.1, (0.03, 0.03)),  # flat: its width has no effect
        (2.1e-3, 0.1, None),
    ],
)
def test_a_loop_that_acts_like_something_else_starts_again_as_a_small_one(
    hysteresis: float, presliding: float, found: tuple[float, float] | None
) -> None:
    """Level over the largest torque, and width over the largest deflection."""
    inertia, elasticity = ROBOTS[1]
    phasors = plant_phasors(inertia, elasticity, *campaign(BAND_HZ, 1))
    peak = np.abs(phasors.tau + phasors.omega[:, None] ** 2 * inertia.M * phasors.q).max()
    layout = ParameterLayout.of(1, effects=["hysteresis"])
    together = 40.0 + hysteresis / presliding * 40.0  # of the spring and the loop
    wide = presliding > 0.2
    scale = peak / (together if wide else 40.0)
    level = hysteresis * peak * (40.0 / together if wide else 1.0)
    p = layout.named(layout.pack(K=[40.0], D=[0.1], hysteresis=[level], presliding=[presliding * scale]))
    starts = other_laws(phasors, InertiaPrior.of(inertia, *phasors.q.shape), p, p, is_near=True)
    assert len(starts) == (found is not None)
    if found is not None:
        (start,) = starts
        K = 40.0 + level / (presliding * scale) if wide else 40.0
        assert start.K[0] == pytest.approx(K)
        assert start["hysteresis"][0] == pytest.approx(found[0] * peak)
        assert start["presliding"][0] == pytest.approx(found[1] * peak / K)


def test_the_mean_of_the_lags_starts_as_a_delay() -> None:
    layout = ParameterLayout.of(2, effects=["lag"])
    p = layout.named(layout.pack(K=[40, 7], D=[0.1, 0.2], lag=[1e-3, 3e-3]))
    delayed = with_delay(p)
    assert delayed["delay"] == pytest.approx(2e-3)
    np.testing.assert_array_equal(delayed.vector[:-1], p.vector)
    assert with_delay(delayed) is delayed
    plain = ParameterLayout.of(2)
    none = plain.named(plain.pack(K=[40, 7], D=[0.1, 0.2]))
    assert with_delay(none) is none


def test_models_are_named_by_their_parts() -> None:
    assert Model(None, delay=False).name == "elasticity"
    assert Model(0.0, delay=True).name == "elasticity + friction + delay"
    assert Model(0.03, delay=False).name == "elasticity + friction, reversals free below 3 %"
    curved = Model(0.1, delay=False, curve=True).name
    assert curved == "elasticity + friction that varies with speed, reversals free below 10 %"


def test_numbers_of_a_friction_curve_are_named_by_joint() -> None:
    (block,) = (
        b for b in ParameterLayout.of(2, friction=True, curve_parts=2).blocks if b.name == "curve"
    )
    names = [f"friction curve {c} of joint {j}" for j in (1, 2) for c in (1, 2)]
    assert list(block.labels) == names


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("presliding", 1.01e-4, True),
        ("presliding", 0.99e-4, False),
        ("presliding", 1.99, True),
        ("presliding", 2.01, False),
        ("hysteresis", 3.99, True),
        ("hysteresis", 4.01, False),
        ("backlash", 3.99, True),
        ("backlash", -4.01, False),
        ("piecewise", -1.79, True),  # the least slope is a tenth of the first
        ("piecewise", -1.81, False),
        ("second_bend", -1.29, True),
        ("second_bend", -1.31, False),
        ("knee", 0.0, False),
        ("K", 0.0, False),
        ("K", 8.99, True),
        ("K", 9.0, False),
        ("D", 0.0, True),
        ("D", -1e-9, False),  # only the observer of motions would hold the arm
    ],
)
def test_laws_of_a_fit_stay_near_the_sizes_of_the_linear_gear(
    name: str, value: float, allowed: bool
) -> None:
    """In units at which a law is as large as the linear gear, of 2 N·m/rad; another joint is usual."""
    usual = {"K": 2.0, "D": 0.1, "hysteresis": 1.0, "presliding": 1.0, "backlash": 1.0}
    usual |= {"piecewise": -0.5, "knee": 1.0, "second_bend": 0.5, "second_knee": 1.0}
    layout = ParameterLayout.of(2, effects=["piecewise", "backlash", "hysteresis"])
    p = layout.named(layout.pack(**{each: [size, size] for each, size in usual.items()}))
    one = np.ones(2)
    units = dict.fromkeys(("presliding", "hysteresis", "backlash", "knee", "second_knee"), one)
    problem: Any = SimpleNamespace(
        layout=layout, stiffest=9.0, laws=SimpleNamespace(units=lambda _: units, motors=True)
    )
    assert Problem.feasible(problem, p.vector)
    values = {each: [size, size] for each, size in usual.items()} | {name: [usual[name], value]}
    assert Problem.feasible(problem, layout.pack(**values)) == allowed


LINEAR, SOFT = Model(None, delay=False), Model(None, delay=False, effects=("cubic",))
RUBBING, LAGGING = Model(0.0, delay=False), LINEAR.with_part("lag")


@pytest.mark.parametrize(
    ("wider", "leading", "misfits", "motions", "explained", "passed"),
    [
        (SOFT, LINEAR, (1.0, 9.0), False, True, False),  # no other extension leads
        (SOFT, LAGGING, (1.05, 9.0), False, False, True),  # a lag explains the data: no law
        (SOFT, LAGGING, (1.15, 9.0), False, False, False),
        (SOFT, LAGGING, (1.05, 1.09), False, False, False),
        (SOFT, LAGGING, (1.15, 9.0), False, True, True),
        (SOFT, LAGGING, (1.39, 2.0), True, False, True),  # of motions a clear climb is enough
        (SOFT, LAGGING, (1.41, 2.0), True, False, False),
        (RUBBING, LINEAR.with_part("delay"), (1.05, 9.0), False, False, False),
        (LINEAR.with_part("delay"), LAGGING, (1.05, 9.0), True, True, False),
        (LINEAR.with_part("delay"), RUBBING, (2.0, 9.0), True, False, True),  # richer friction first
    ],
)
def test_fits_that_others_make_superfluous_are_passed_over(
    wider: Model,
    leading: Model,
    misfits: tuple[float, float],
    motions: bool,
    explained: bool,
    passed: bool,
) -> None:
    fits = SimpleNamespace(
        misfit=lambda model: misfits[model == LINEAR], is_explained=lambda _: explained
    )
    search: Any = SimpleNamespace(fits=fits, has_motions=motions)
    assert _is_passed_over(search, wider, LINEAR, leading) == passed


def test_richer_friction_is_fitted_before_other_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """They absorb some of it, and their scores are not needed where it explains more."""

    def unneeded(*_: Any) -> None:
        raise AssertionError("other parts are not looked for")

    monkeypatch.setattr(model_growth, "_extensions", unneeded)
    monkeypatch.setattr(model_growth, "_best_extension", lambda _search, _best, found: found[0])
    fits = SimpleNamespace(estimate=lambda _: SimpleNamespace())
    search: Any = SimpleNamespace(fits=fits, may_be_richer=lambda _: True)
    assert grown(search, RUBBING) == replace(RUBBING, reversal=0.03)


def test_inertias_do_not_follow_from_records_under_gravity_or_of_several_poses() -> None:
    inertia, elasticity = ROBOTS[1]
    phasors = plant_phasors(inertia, elasticity, *campaign(BAND_HZ, 1))
    pulled, added = Inertia(inertia.M, inertia.M2, gravity=[[2.0]]), inertia.with_added([[1e-3]])
    poses = [inertia if k % 2 else Inertia(inertia.M, 2 * inertia.M2) for k in range(BAND_HZ.size)]
    for given, found in ((inertia, True), (pulled, False), (added, False), (poses, False)):
        prior = InertiaPrior.of(given, *phasors.q.shape)
        assert (without_inertias(phasors, prior) is not None) == found


def test_a_search_that_gives_up_fits_the_first_models_from_the_first_start_that_allows_one() -> None:
    phasors = plant_phasors(*ROBOTS[1], *campaign(BAND_HZ, 1))
    model, starts = Model(None, delay=False), ["a", "b", "c"]
    tried: list[str] = []

    def fit(_: Model, start: str) -> None:
        tried.append(start)
        fits.least_misfit = 7.0 if start == "b" else np.inf

    fits = SimpleNamespace(
        least_misfit=np.inf, least=lambda: model, tried={model: "estimate"}, candidates=lambda _: ()
    )
    search: Any = SimpleNamespace(
        phasors=phasors, prior=InertiaPrior.of(ROBOTS[1][0], *phasors.q.shape), base=model, fits=fits,
        free_start=lambda: starts, fit=fit,
    )  # fmt: skip
    choice = _given_up(search)
    assert tried == ["a", "b"]
    assert (choice.model, choice.estimate) == (model, "estimate")
    np.testing.assert_array_equal(choice.spread, np.zeros((2, 2)))


def test_a_joint_without_damping_starts_with_a_little() -> None:
    """Half a per cent of the stiffness at the highest frequency: a fit from zero would stay there."""
    inertia, elasticity = ROBOTS[2]
    undamped = Elasticity(elasticity.K, [1e-9, 1e-9])
    phasors = plant_phasors(inertia, undamped, *campaign(BAND_HZ, 2))
    start = without_inertias(phasors, InertiaPrior.of(inertia, *phasors.q.shape))
    assert start is not None
    np.testing.assert_allclose(start.D, 0.005 * start.K / phasors.omega.max(), rtol=1e-9)


def test_the_largest_torque_is_that_of_a_sine_or_of_all_lines_of_a_motion() -> None:
    """Less the rotor's, which moves with s² q; each joint has its own largest record."""
    harmonics = np.zeros((3, 2, 4), complex)
    harmonics[0, 0], harmonics[0, 1] = [0.1, 0, 5.0, 4.0j], [0, 0, 99.0, 99.0]
    harmonics[1, 0], harmonics[1, 1] = [0, 0, 3.0, 3.0], [0, 0.2j, 4.0j, 4.0]
    harmonics[2, 0] = [0, 0, 1.0, 1.0]
    phasors: Any = SimpleNamespace(
        harmonics=harmonics, omega=np.array([2.0, 3.0, 1.0]), motion=np.array([False, True, True])
    )
    prior = InertiaPrior.of(Inertia([10.0, 0.5], np.eye(2)), 3, 2)
    # Joint 1: 5 + 4·10·0.1 = 9. Joint 2: 3 and 4 + 36·0.5·0.2i.
    found = _largest_torque(phasors, prior)
    np.testing.assert_allclose(found, [9.0, np.sqrt(9 + 16 + 3.6**2)])
