"""Torque ripple and transmission error: their waveforms, their derivatives and their identification."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plants import exact_phasors
from random_cases import tries

from benchmarks.independent_robot import MAX_STEP_S, paper_motions, simulate
from benchmarks.real_robots import PAPER, Loads, band
from jointid import Inertia, MotionRecord, SineRecord, Study, analyse, extract_phasors
from jointid.analysis import Analysis
from jointid.estimation import periodic_effects
from jointid.estimation.candidates import Model
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.maximum_likelihood import LikelihoodEstimate
from jointid.estimation.estimators.noise import Noise
from jointid.estimation.estimators.problem import fitted_layout, make_problem
from jointid.estimation.estimators.residual import Residual
from jointid.estimation.estimators.score_tests import PerTurnScores, scores_per_turn
from jointid.estimation.estimators.whitened_residual import WhitenedResidual
from jointid.estimation.model_fits import completed
from jointid.estimation.periodic_effects import _clearest, _effect, _fit_orders, _fitted, fit_periodic
from jointid.motion.friction import GRID, GearTorque, friction_waveforms
from jointid.motion.per_turn import PerTurn, turn_waves, with_turns
from jointid.motion.spectra import motion_phasors

TRUE = np.concatenate([PAPER.K, PAPER.D])
SIDES = ("", "_quadrature")
PER_TURN = (PerTurn("ripple", (6, 0), (0.4, 0.0)), PerTurn("transmission", (2, 3), (0.0, 1.0)))


def records_of(
    seed: int, noise: float = 0.005, amplitude: float = 1.0, **effects: object
) -> list[SineRecord]:
    """Sines of the paper's robot with further effects."""
    steps = {"max_step_s": tries(5e-4, nightly=MAX_STEP_S)}
    experiment = paper_motions(PAPER, band(PAPER, 0.3, 3, 10), seed=seed, noise=noise, **steps)
    experiment = replace(experiment, amplitude_rad=amplitude * experiment.amplitude_rad)
    (records,) = simulate([(replace(PAPER, **effects), experiment)])
    return records


def analysed(records: list[SineRecord]) -> Analysis:
    return analyse(Study(records, Inertia(1.02 * PAPER.M, 0.98 * PAPER.M2), inertia_std=0.03))


def amplitude(found: Analysis, name: str) -> np.ndarray:
    p = found.fit.parameters
    return np.hypot(p[name], p[f"{name}_quadrature"])


def test_waves_are_those_of_the_position() -> None:
    """Phasors of cos kθ and sin kθ by projection on a long record of whole periods."""
    rate, hz = 2000.0, 4.0
    t = np.arange(2000) / rate
    theta = 0.3 + 0.8 * np.sin(2 * np.pi * hz * t)
    record = SineRecord(
        hz, t, theta[:, None], np.cos(6 * theta)[:, None] + 1e-6 * np.sin(9 * t)[:, None]
    )
    phasors = extract_phasors([record], harmonics=20)
    cosine, sine = turn_waves(phasors, np.array([6]))
    basis = np.exp(-2j * np.pi * hz * np.outer(np.arange(1, 21), t))
    for found, wave in ((cosine, np.cos(6 * theta)), (sine, np.sin(6 * theta))):
        np.testing.assert_allclose(found[0, :, 0], 2j / t.size * basis @ wave, atol=1e-6)
    assert not turn_waves(phasors, np.array([0])).any()
    once = turn_waves(phasors, np.array([1]))[1, 0, :, 0]
    np.testing.assert_allclose(once, 2j / t.size * basis @ np.sin(theta), atol=1e-6)


def test_derivatives_are_those_of_the_residual() -> None:
    """Columns of both effects, of K and D beside them, by central differences."""
    phasors = extract_phasors(records_of(1)[::4], harmonics=12)
    prior = InertiaPrior.of(Inertia(PAPER.M, PAPER.M2), *phasors.q.shape)
    parts = ("friction", "ripple", "transmission")
    names = {"coulomb": [0.01, 0.02], "ripple": [0.02, 0.0], "transmission": [1e-3, 2e-3]}
    start = fitted_layout(prior, friction_waveforms(phasors, None), False, parts[1:])
    p = start.named(start.pack(K=PAPER.K, D=PAPER.D, **names))
    model = Model(0.0, delay=False, per_turn=PER_TURN)
    waves = completed(friction_waveforms(phasors, None), model, phasors, prior, p, parts)
    layout = fitted_layout(prior, waves, False, parts[1:])
    problem = make_problem(
        phasors, prior, layout, p, waves, Noise(phasors.harmonic_covariance, phasors.degrees_of_freedom)
    )
    vector = problem.start(p)
    vector[layout["transmission_quadrature"]] = [5e-4, -1e-3]
    J = Residual.at(problem, vector).jacobian(problem.z)
    for name in ("ripple", "ripple_quadrature", "transmission", "transmission_quadrature", "K", "D"):
        for k in range(layout[name].start, layout[name].stop):
            step = np.zeros(vector.size)
            step[k] = 1e-4 * max(abs(vector[k]), 1e-3)
            ahead, behind = (Residual.at(problem, vector + sign * step).r for sign in (1, -1))
            expected = (ahead - behind) / (2 * step[k])
            np.testing.assert_allclose(J[..., k], expected, atol=2e-6 * np.abs(expected).max() + 1e-9)


@pytest.mark.parametrize(("order", "share"), [(6, 0.01), (24, 0.02)])
def test_torque_ripple_is_found_and_leaves_k_and_d(order: int, share: float) -> None:
    """Such data were called not usable, or K was up to 10 stated errors off without a warning."""
    experiment = paper_motions(PAPER, band(PAPER, 0.3, 3, 10), seed=2)
    size = share * Loads.of(PAPER, experiment).torque
    found = analysed(records_of(2, ripple_Nm=size, per_turn=order, phase=[0.7, 2.1]))
    assert found.state == "usable"
    np.testing.assert_allclose(amplitude(found, "ripple"), size, rtol=0.02)
    assert np.abs((found.fit.estimate - TRUE) / found.fit.standard_error).max() < 4
    assert np.abs(found.fit.estimate / TRUE - 1).max() < 3e-3
    (told,) = (each for each in found.findings if "torque ripple" in each.title)
    assert f"{order} periods per turn" in told.detail


def test_transmission_error_is_found_where_the_motors_turn_far() -> None:
    """Without it in the model, K was 7 % off; it decides the gear ratio where motors turn little."""
    experiment = paper_motions(PAPER, band(PAPER, 0.3, 3, 10), seed=3)
    size = 0.1 * Loads.of(PAPER, experiment).deflection
    wavy = {"transmission_rad": size, "per_turn": 2, "phase": [0.7, 2.1]}
    found = analysed(records_of(3, amplitude=3.0, **wavy))
    assert found.state == "usable"
    np.testing.assert_allclose(amplitude(found, "transmission"), size, rtol=0.02)
    assert np.abs((found.fit.estimate - TRUE) / found.fit.standard_error).max() < 4
    (told,) = (each for each in found.findings if "transmission error" in each.title)
    assert "2 periods per turn" in told.detail


def test_waves_of_a_motion_are_those_of_its_position() -> None:
    rate = 500.0
    t = np.arange(2000) / rate
    theta = 1.0 + 0.6 * np.sin(2 * np.pi * 1.3 * t) + 0.3 * np.sin(2 * np.pi * 4.7 * t)
    rng = np.random.default_rng(1)
    tau = 0.01 * rng.standard_normal((t.size, 1)) + np.sin(2 * np.pi * 3.1 * t)[:, None]
    record = MotionRecord(t, theta[:, None], tau, band_hz=(1.0, 20.0))
    phasors = motion_phasors([record], np.array([[1e-3]]))
    cosine, _ = turn_waves(phasors, np.array([4]))
    (segment,) = phasors.segments
    at = slice(segment.begin, segment.end)
    spectrum = np.fft.rfft(np.cos(4 * theta[at])) * 2j / segment.samples
    bins = np.arange(segment.lowest, segment.highest + 1)
    np.testing.assert_allclose(cosine[0, bins - 1, 0], spectrum[bins], atol=1e-12)
    assert not cosine[0, : segment.lowest - 1].any()


def scripted(monkeypatch: pytest.MonkeyPatch, gain: np.ndarray, **costs: float) -> tuple[Any, list[Any]]:
    """A search with gains (orders, n) of a ripple, and the effects that are fitted; cost 10 by default.

    ``costs`` are those of fits by orders, as in ``o35`` for 3 and 5.
    """
    fitted: list[Any] = []

    def fit(_: Any, model: Model, effect: PerTurn, __: Any) -> Any:
        fitted.append((model.reversal, effect.orders))
        cost = costs.get("o" + "".join(map(str, effect.orders)), 10.0)
        return SimpleNamespace(misfit=1.0, cost=cost, named=SimpleNamespace(without=lambda *_: "near"))

    phase = np.arange(gain.size, dtype=float).reshape(gain.shape)
    monkeypatch.setattr(periodic_effects, "_fitted", fit)
    monkeypatch.setattr(
        periodic_effects, "_scores", lambda *_: {"ripple": PerTurnScores(gain, phase, 0 * gain)}
    )
    return SimpleNamespace(has_motions=False), fitted


def test_orders_are_those_of_the_highest_score_of_each_joint(monkeypatch: pytest.MonkeyPatch) -> None:
    gain = np.zeros((6, 2))
    gain[2, 0], gain[4, 1] = 5.0, 3.0
    search, fitted = scripted(monkeypatch, gain)
    model: Any = Model(0.0, delay=False)
    _fit_orders(search, model, PerTurn("ripple", (1, 1), (0.0, 0.0)), "near")  # type: ignore[arg-type]
    assert fitted == [(0.0, (1, 1)), (0.0, (3, 5))]
    search, fitted = scripted(monkeypatch, gain)
    _fit_orders(search, model, PerTurn("ripple", (0, 2), (0.0, 0.0)), "near")  # type: ignore[arg-type]
    assert fitted == [(0.0, (0, 2)), (0.0, (0, 5))]  # the first joint has no ripple


def test_an_effect_has_the_phase_at_its_order() -> None:
    phase = np.arange(12.0).reshape(6, 2)
    found = _effect("ripple", np.array([3, 0]), phase)
    assert found == PerTurn("ripple", (3, 0), (4.0, 1.0))


@pytest.mark.parametrize(
    ("gain", "straight", "optional", "orders"),
    [
        ([[1.0, 1.0], [60.0, 2.0]], 0.0, (), (2, 0)),  # the second joint's is chance
        ([[40.0, 1.0], [30.0, 50.0]], 0.0, (), (1, 2)),
        ([[60.0, 1.0], [1.0, 1.0]], 1e3, (), None),  # as a straight line
        ([[60.0, 1.0], [1.0, 1.0]], 0.0, ("ripple",), None),  # is in the model
        ([[0.1, 0.1], [0.1, 0.1]], 0.0, (), None),
    ],
)
def test_the_clearest_effect_is_that_of_joints_beyond_chance(
    monkeypatch: pytest.MonkeyPatch, gain: Any, straight: float, optional: Any, orders: Any
) -> None:
    scores = PerTurnScores(np.array(gain), np.zeros((2, 2)), np.array([straight, 0.0]))
    monkeypatch.setattr(periodic_effects, "_scores", lambda *_: {"ripple": scores})
    search: Any = SimpleNamespace(
        scores=lambda _: {"gravity": SimpleNamespace(gain=1e9)},
        fits=SimpleNamespace(optional=optional),
        has_motions=False,
    )
    estimate: Any = SimpleNamespace(cost=100.0, expected_cost=90.0, misfit=1.0, named=None)
    found = _clearest(search, Model(None, delay=False), estimate)
    assert (found and found.orders) == orders


def test_the_score_of_an_order_is_the_cost_that_its_wave_saves() -> None:
    """A ripple of known phase on a robot without noise: all that K and D leave, at its order alone."""
    rng, n, H, hz = np.random.default_rng(2), 2, 24, np.array([3.0, 5.0, 8.0, 12.0])
    inertia, true = Inertia(PAPER.M, PAPER.M2), np.concatenate([PAPER.K, PAPER.D])
    s, z = 2j * np.pi * hz, np.full((4, H, 2 * n), 1e-15 + 0j)
    z[:, 0, :n] = rng.uniform(0.5, 1.0, (4, n)) * np.exp(2j * np.pi * rng.random((4, n)))
    for r in range(4):
        gear, arm = np.diag(PAPER.K + s[r] * PAPER.D), s[r] ** 2 * inertia.M2
        passed = gear @ (np.eye(n) - np.linalg.solve(arm + gear, gear))
        z[r, 0, n:] = (s[r] ** 2 * np.diag(inertia.M) + passed) @ z[r, 0, :n]
    noise = np.tile(np.diag([1e-12, 1e-12, 1e-6, 1e-6]).astype(complex), (4, H, 1, 1))
    phasors = replace(
        exact_phasors(hz, z[:, 0, :n], z[:, 0, n:]),
        harmonics=z, harmonic_covariance=noise, harmonic_rounding=np.zeros(z.shape),
    )  # fmt: skip
    (sine, _) = PerTurn("ripple", (0, 6), (0.0, 0.7)).waves(phasors)
    z = z + np.concatenate([0 * sine, 0.01 * sine], axis=2)
    phasors = replace(phasors, tau=z[:, 0, n:], harmonics=z)
    prior, of_noise = InertiaPrior.of(inertia, 4, n), Noise(noise, np.full(4, 1e6))
    layout = fitted_layout(prior, None, False)
    near = layout.named(true)
    found = scores_per_turn(phasors, prior, near, None, of_noise, False, (), range(1, 9))["ripple"]
    linear = WhitenedResidual.of(make_problem(phasors, prior, layout, near, None, of_noise), true)
    columns, rows = linear.columns().reshape(-1, 2 * n), linear.rows.ravel()
    left = rows - columns @ (np.linalg.lstsq(columns * true, rows, rcond=None)[0] * true)
    assert found.gain[5, 1] == pytest.approx(left @ left, rel=1e-6)
    assert found.phase[5, 1] == pytest.approx(0.7, abs=1e-6)
    others = np.delete(found.gain.ravel(), 11)
    assert np.all((others >= 0) & (others < 0.9 * found.gain[5, 1]))


def test_a_ripple_is_a_torque_and_a_transmission_error_moves_the_gear_without_work() -> None:
    """Over a period, under a constant torque of the gears."""
    q = np.array([[0.8 + 0.3j, 0.5j], [0.2, 0.7]])
    z = np.zeros((2, 31, 4), complex)
    z[:, 0] = np.hstack([q, q])
    phasors = exact_phasors(np.array([3.0, 5.0]), q, q)
    noise = np.tile(1e-12 * np.eye(4, dtype=complex), (2, 31, 1, 1))
    phasors = replace(
        phasors,
        harmonics=z + 1e-15, harmonic_covariance=noise, harmonic_rounding=np.zeros(z.shape),
    )  # fmt: skip
    ripple, error = PerTurn("ripple", (2, 1), (0.3, 0.0)), PerTurn("transmission", (1, 2), (0.0, 0.9))
    steady = GearTorque(np.full((2, 2, GRID), 7.0), {})
    found = with_turns(friction_waveforms(phasors, None), phasors, (ripple, error), steady)
    np.testing.assert_allclose([found.further[f"ripple{end}"] for end in SIDES], ripple.waves(phasors))
    moved = [found.deflection[f"transmission{end}"] for end in SIDES]
    np.testing.assert_allclose(moved, error.waves(phasors))
    assert len(found.deflection) == 2
    velocity = 2j * np.pi * phasors.frequency_found_hz[:, None] * q
    for end in SIDES:
        wave = found.further[f"transmission{end}"][:, 0]
        assert np.abs((wave.conj() * velocity).real).max() < 1e-6 * np.abs(wave * velocity).max()


def test_harmonics_of_the_angle_below_their_noise_do_not_turn_the_waves() -> None:
    z = np.full((1, 9, 2), 1e-15 + 0j)
    z[0, 0], z[0, 1, 0] = 0.8, 0.05
    covariance = np.tile(np.eye(2, dtype=complex) * 1e-8, (1, 9, 1, 1))
    clean = replace(
        exact_phasors(np.ones(1), z[:, 0, :1], z[:, 0, 1:]), harmonics=z, harmonic_covariance=covariance
    )
    hidden = z.copy()
    hidden[0, 4:, 0] = 1e-5
    noisy = replace(clean, harmonics=hidden)
    waves = turn_waves(clean, np.array([3]))
    assert np.abs(waves).max() > 0.1
    np.testing.assert_allclose(turn_waves(noisy, np.array([3])), waves, atol=1e-12)


def test_one_fit_of_each_order_suffices() -> None:
    """Whatever its phase, which is fitted; not where another part differs."""
    linear: Any = Model(None, delay=False)
    known = object.__new__(LikelihoodEstimate)
    one, turned, other = (
        PerTurn("ripple", (k, 0), (phase, 0.0)) for k, phase in ((6, 0.4), (6, 0.9), (5, 0.4))
    )
    fitted = []
    sliding: Any = replace(linear, reversal=0.0)
    before = replace(sliding.with_part("ripple"), per_turn=(one,))
    fits = SimpleNamespace(tried={before: known}, estimate=lambda model: "new")
    search: Any = SimpleNamespace(fits=fits, fit=lambda model, *_, **__: fitted.append(model.per_turn))
    assert _fitted(search, sliding, turned, "near") is known  # type: ignore[arg-type]
    assert not fitted
    assert _fitted(search, sliding, other, "near") == "new"  # type: ignore[arg-type,comparison-overlap]
    assert _fitted(search, replace(sliding, delay=True), one, "near") == "new"  # type: ignore[arg-type,comparison-overlap]
    assert fitted == [(other,), (one,)]


@pytest.mark.parametrize(("reversal", "of_friction"), [(None, 0.0), (0.0, 0.0), (0.03, 0.03)])
@pytest.mark.parametrize("misfit", [1.4, 1.6])
def test_periodic_effects_are_fitted_beside_friction(
    monkeypatch: pytest.MonkeyPatch, reversal: float | None, of_friction: float, misfit: float
) -> None:
    """Also without gravity, which they may imitate; not where little is left."""
    effect, model = (
        PerTurn("ripple", (6, 0), (0.4, 0.0)),
        Model(reversal, delay=False, effects=("gravity",)),
    )
    found = SimpleNamespace(misfit=misfit, named="near")
    tried: list[tuple[Any, ...]] = []
    left = [effect]

    def fit_orders(_: Any, model: Model, effect: PerTurn, near: Any) -> None:
        tried.append((model, effect, near))

    monkeypatch.setattr(periodic_effects, "_clearest", lambda *_: left.pop() if left else None)
    monkeypatch.setattr(periodic_effects, "_fit_orders", fit_orders)
    fits = SimpleNamespace(
        estimate=lambda _: found, optional=(), tried={model: found}, misfit=lambda _: misfit
    )
    search: Any = SimpleNamespace(
        fits=fits, has_motions=True, may_be_periodic=True, is_lost=False, add_per_turn=lambda _: None
    )
    assert fit_periodic(search, model) == (misfit > 1.5)
    sliding = replace(model, reversal=of_friction, per_turn=(effect,))
    both = [(each, effect, "near") for each in (sliding, sliding.without("gravity"))]
    assert tried == (both if misfit > 1.5 else [])
    tried.clear()
    search.may_be_periodic = False
    assert not fit_periodic(search, model)
    assert not tried


def test_a_transmission_error_changes_the_gear_ratio_by_its_slope() -> None:
    layout = fitted_layout(
        InertiaPrior.of(Inertia(PAPER.M, PAPER.M2), 1, 2), None, False, ("transmission",)
    )
    p = layout.named(layout.pack(transmission=[3e-3, 0.01], transmission_quadrature=[4e-3, 0.0]))
    estimate: Any = SimpleNamespace(named=p)
    model = Model(0.0, delay=False, effects=("ripple", "transmission"), per_turn=PER_TURN)
    np.testing.assert_allclose(model.ratio_error(estimate), [2 * 5e-3, 3 * 0.01])
