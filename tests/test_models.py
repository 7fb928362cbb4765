"""Comparison of models at its thresholds, with handwritten estimates."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plants import exact_phasors
from scipy.special import chdtri

from jointid.errors import JointIdError
from jointid.estimation import candidates, model_fits, model_growth, model_search, model_selection
from jointid.estimation.candidates import Fits, Model, dissipates, fundamental_chance
from jointid.estimation.estimators.noise import Noise
from jointid.estimation.estimators.parameters import ParameterLayout
from jointid.estimation.model_average import _fundamentals_are_alike, spread, spread_of_modes
from jointid.estimation.model_growth import _RICHER, NARROWER
from jointid.estimation.model_search import Search

PLAIN = Model(None, delay=False)
RUBBING, FREE = Model(0.0, delay=False), Model(0.03, delay=False)
ROWS = 1000
LN = np.log(ROWS)


@pytest.fixture(autouse=True)
def handwritten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(candidates, "LikelihoodEstimate", SimpleNamespace)


def estimate(
    model: Model = PLAIN,
    cost: float = 100.0,
    misfit: float = 1.0,
    chance: float = 0.5,
    free: int = 0,
    errors: dict[str, float] | None = None,
    **values: float,
) -> Any:
    """Estimate of one joint of K = 20 ± 0.1 N·m/rad; other parameters are as given, with errors of 1."""
    layout = ParameterLayout.of(
        1, friction=model.reversal is not None, delay=model.delay, effects=model.effects
    )
    given = {"K": 20.0, "D": 0.1, **values}
    blocks = {block.name: block for block in layout.blocks}
    p = layout.pack(**{name: np.full(blocks[name].shape, given.get(name, 0.0)) for name in blocks})
    std = np.ones(p.size)
    for name, error in {"K": 0.1, "D": 0.01, **(errors or {})}.items():
        std[layout[name]] = error
    found = SimpleNamespace(
        p=p, layout=layout, named=layout.named(p), covariance=np.diag(std**2), cost=cost, misfit=misfit,
        fundamental=(chdtri(10, chance) / 10, 10), parameter_count=p.size + free, repeated=0.0,
        expected_cost=99.0, elasticity=p[:2], elasticity_covariance=np.diag(std[:2] ** 2),
    )  # fmt: skip
    found.whole_cost = lambda misfit: found.cost / misfit
    return found


def significant(model: Model, part: str, simpler: Any = None, **values: Any) -> bool:
    found = estimate(model, **values)
    fits = Fits((part,), ROWS, {model: found})
    if simpler is not None:
        fits.tried[model.without(part)] = simpler
    return fits.part_is_significant(model, found, part)


def test_the_chance_is_that_of_a_larger_misfit() -> None:
    assert fundamental_chance(estimate(chance=0.2)) == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("coulomb", "viscous", "found"), [(2.01, 0, True), (1.99, 4.99, False), (-9, 5.01, True)]
)
def test_friction_takes_energy(coulomb: float, viscous: float, found: bool) -> None:
    assert dissipates(estimate(RUBBING, coulomb=coulomb, viscous=viscous)) == found


def test_a_criterion_is_the_cost_with_a_penalty_for_parameters() -> None:
    tried = {PLAIN: estimate(misfit=4.0), RUBBING: estimate(RUBBING, misfit=2.0, cost=60.0, free=3)}
    fits = Fits((), ROWS, {**tried, FREE: JointIdError("no fit")})
    found = fits.criterion()  # costs over the least misfit
    assert found == {
        PLAIN: pytest.approx(100 + 2 * LN), RUBBING: pytest.approx(60 + 4 * LN + 6), FREE: np.inf,
    }  # fmt: skip
    assert fits.least_misfit == 2.0
    assert fits.misfit(FREE) == np.inf
    assert fits.least([PLAIN, RUBBING, FREE]) == RUBBING
    ordered = fits.candidates(RUBBING)
    assert [each.model for each in ordered] == [RUBBING, PLAIN, FREE]
    assert [each.chosen for each in ordered] == [True, False, False]
    assert [each.parameters for each in ordered] == [7, 2, 0]
    assert [each.problem for each in ordered] == ["", "", "no fit"]
    tried[RUBBING].misfit = 0.5  # below noise, it is 1
    assert fits.criterion()[PLAIN] == pytest.approx(200 + 2 * LN)
    assert Fits((), ROWS).least_misfit == np.inf


def test_of_models_without_a_significant_part_the_cheapest_is_taken() -> None:
    late, lagging = Model(None, delay=True), PLAIN.with_part("lag")
    tried = {lagging: estimate(lagging, cost=80.0, lag=0.1), late: estimate(late, cost=50.0, delay=0.1)}
    fits = Fits(("delay", "lag"), ROWS, tried)
    assert set(fits.criterion().values()) == {np.inf}
    assert fits.least([lagging, late]) == fits.least([late, lagging]) == late


@pytest.mark.parametrize(
    ("sharp", "free", "kept"),
    [(1.1e-3, 0.9, True), (0.9e-3, 0.051, False), (0.9e-3, 0.049, True)],
)
def test_reversals_that_do_not_explain_the_fundamentals_are_out(
    sharp: float, free: float, kept: bool
) -> None:
    """If others of the same parts do; a better criterion counts for nothing."""
    fits = Fits(
        (), ROWS, {RUBBING: estimate(RUBBING, cost=1, chance=sharp), FREE: estimate(FREE, chance=free)}
    )
    assert np.isfinite(fits.criterion()[RUBBING]) == kept


@pytest.mark.parametrize(
    ("misfit", "chance", "found"), [(1.1, 0.051, True), (1.11, 0.5, False), (1, 0.049, False)]
)
def test_noise_explains_a_model_at_all_harmonics_and_at_the_fundamentals(
    misfit: float, chance: float, found: bool
) -> None:
    fits = Fits((), ROWS, {PLAIN: estimate(misfit=misfit, chance=chance)})
    assert fits.is_explained(PLAIN) == found
    assert not fits.is_explained(RUBBING)


@pytest.mark.parametrize(("cost", "behind"), [(50.1, True), (49.9, False)])
def test_a_model_with_less_cannot_win_what_its_parameters_do_not_save(cost: float, behind: bool) -> None:
    """A lag of a joint saves ln(rows) and no cost; friction is another matter."""
    wide = PLAIN.with_part("lag")
    tried = {PLAIN: estimate(cost=50.0), wide: estimate(wide, cost=cost)}
    fits = Fits((), ROWS, tried)
    assert fits.is_behind(PLAIN, wide) == behind
    assert not fits.is_behind(RUBBING, wide)
    assert not fits.is_behind(PLAIN, FREE)
    tried[RUBBING] = estimate(RUBBING, cost=900.0)
    assert not fits.is_behind(PLAIN, RUBBING)


def test_a_part_of_fourteen_errors_is_certain() -> None:
    """Their square is 200; the errors grow with the misfit."""
    delayed = PLAIN.with_part("delay")
    for delay, misfit, certain in (
        (14.2, 0.5, True), (14.1, 1.0, False), (14.2, 1.1, False), (-29, 4.0, True),
    ):  # fmt: skip
        fits = Fits((), ROWS, {delayed: estimate(delayed, delay=delay, misfit=misfit)})
        assert fits.is_certain(delayed, "delay") == certain
    fits = Fits((), ROWS, {delayed: estimate(delayed, delay=9.0, errors={"delay": 0.0})})
    assert not fits.is_certain(delayed, "delay")
    assert not fits.is_certain(PLAIN, "delay")


@pytest.mark.parametrize(("coulomb", "found"), [(-6.9, True), (-7.1, False), (0.0, True), (9.0, True)])
def test_friction_beside_presliding_must_not_be_negative_together(coulomb: float, found: bool) -> None:
    """Presliding of 2 errors; each part is tested for itself."""
    model = replace(RUBBING, effects=("motor_presliding",))
    assert significant(model, "friction", coulomb=coulomb, motor_presliding=2.0) == found


def test_richer_friction_is_wider_or_a_curve_and_ends() -> None:
    """Reversals narrow step by step to the sharp one."""
    for (reversal, curve), richer in _RICHER.items():
        for wider, bent in richer:
            assert (wider, bent) != (reversal, curve)
            assert wider >= reversal
            assert bent >= curve
            assert wider in (0.0, *NARROWER)
            assert (wider, bent) in _RICHER or (wider, bent) == (0.1, True)
    assert {(reversal, curve) for reversal in (0.0, 0.03, 0.1) for curve in (False, True)} == {
        *_RICHER, (0.1, True)
    }  # fmt: skip
    widths = sorted(NARROWER)
    assert [NARROWER[width] for width in widths] == [0.0, *widths[:-1]]


@pytest.mark.parametrize(("size", "found"), [(0.5, True), (0.03, False)])
def test_a_curve_of_friction_is_significant_as_a_whole(size: float, found: bool) -> None:
    """Slow and fast parts imitate each other: none differs from zero by its own error.

    The true model was rejected, and lags with gravity took its place: K1 12 stated errors off, usable.
    """
    layout = ParameterLayout.of(1, friction=True, curve_parts=2)
    p = layout.pack(K=20.0, D=0.1, coulomb=size, curve=[size, -size])
    rubbed = layout.of_part("friction")
    covariance = np.diag([0.1**2, 0.01**2, *np.full(layout.size - 2, 0.01**2)])
    covariance[rubbed, rubbed] += 1.0  # their sum is hardly known
    fitted: Any = SimpleNamespace(
        p=p, layout=layout, named=layout.named(p), covariance=covariance, misfit=1.0
    )
    model = replace(RUBBING, curve=True)
    assert np.all(np.abs(p[rubbed]) < 5 * np.sqrt(np.diag(covariance)[rubbed]))
    fits = Fits(("friction",), ROWS, {model: fitted})
    assert fits.part_is_significant(model, fitted, "friction") == found


@pytest.mark.parametrize(
    ("delay", "misfit", "found"),
    [(5.01, 1.0, True), (-5.01, 0.5, True), (4.99, 1.0, False), (9.9, 4.0, False), (10.1, 4.0, True)],
)
def test_a_delay_counts_from_five_errors_on(delay: float, misfit: float, found: bool) -> None:
    assert significant(PLAIN.with_part("delay"), "delay", delay=delay, misfit=misfit) == found


@pytest.mark.parametrize(
    ("without", "found"),
    [((2.0, 3.9), False), ((2.24, 3.9), False), ((2.26, 3.9), True), ((6.1, 1), True)],
)
def test_beyond_noise_a_part_must_explain_a_fifth(without: tuple[float, float], found: bool) -> None:
    """With it 2 times the noise remains; without it three times as much makes it needed."""
    misfit, errors = without
    delayed = PLAIN.with_part("delay")
    wide = {"delay": 1.45 * errors + 1.5, "misfit": 2.0}  # 5 √2 errors are significant
    if errors == 3.9:
        assert significant(delayed, "delay", estimate(misfit=misfit), delay=7.2, misfit=2.0) == found
    else:
        assert significant(delayed, "delay", estimate(misfit=misfit), **wide) == found


@pytest.mark.parametrize(
    ("less", "size", "repeated", "found"),
    [(13.05, 1, 0.0, True), (12.95, 1, 0.0, False), (13.05, -1, 0.0, False), (19.45, 1, 0.5, False),
     (19.55, 1, 0.5, True), (50, -5.1, 0.0, False)],
)  # fmt: skip
def test_an_effect_counts_by_the_cost_that_it_saves(
    less: float, size: float, repeated: float, found: bool
) -> None:
    """Twice that exceeds 5² + 1, more where rounding repeats; its standard error says nothing."""
    model = PLAIN.with_part("arm_viscous")
    rubbed = estimate(model, arm_viscous=size)
    rubbed.repeated = repeated
    fits = Fits(("arm_viscous",), ROWS, {model: rubbed, PLAIN: estimate(cost=100 + less)})
    assert fits.part_is_significant(model, rubbed, "arm_viscous") == found


@pytest.mark.parametrize(
    ("change", "found"), [(59.9, True), (60.1, False), (-14.9, True), (-15.1, False)]
)
def test_slopes_of_a_gear_differ_by_a_factor_of_four_at_most(change: float, found: bool) -> None:
    model = PLAIN.with_part("piecewise")
    assert significant(model, "piecewise", estimate(cost=900.0), piecewise=change) == found


@pytest.mark.parametrize(
    ("error", "misfit", "found"), [(3.9, 1, True), (4.1, 1, False), (4.1, 3.1, True)]
)
def test_a_law_leaves_the_spring_determined(error: float, misfit: float, found: bool) -> None:
    """K of 20 with five errors below that, unless the law is needed anyway."""
    model = PLAIN.with_part("cubic")
    plain = estimate(cost=900.0, misfit=99.0)
    assert significant(model, "cubic", plain, cubic=90.0, misfit=misfit, errors={"K": error}) == found


def test_the_error_of_a_spring_is_that_beside_the_torque_scale() -> None:
    found = estimate()
    assert candidates._of_springs(found) == pytest.approx([0.01])
    found.layout = {"torque_scale": slice(2, 3)}
    found.covariance = np.array([[4.0, 0, 1.5], [0, 1, 0], [1.5, 0, 1.0]])
    assert candidates._of_springs(found) == pytest.approx([4 - 1.5**2])
    found.covariance[2, 2] = np.inf
    assert np.isnan(candidates._of_springs(found)).all()


# --- averages


@pytest.mark.parametrize(("behind", "weight"), [(2.0, np.exp(-1)), (5.9, np.exp(-2.95)), (6.1, 0.0)])
def test_models_about_as_good_as_the_best_count_by_their_weight(behind: float, weight: float) -> None:
    """Down to a twentieth of its weight."""
    best, other = estimate(), estimate(Model(None, delay=True), K=23.0, D=0.3)
    other.cost = best.cost + (behind - LN) / 2  # one parameter more
    tried = {PLAIN: best, Model(None, delay=True): other, RUBBING: JointIdError("")}
    found = spread(Fits((), ROWS, tried), PLAIN, best, {})
    shift = np.array([3.0, 0.2])
    np.testing.assert_allclose(found, weight / (1 + weight) * np.outer(shift, shift), atol=1e-12)


@pytest.mark.parametrize(("lower", "alike"), [(1.9, True), (2.1, False)])
def test_fundamentals_that_do_not_ask_for_a_part_are_alike(lower: float, alike: bool) -> None:
    narrow, wide = estimate(), estimate(PLAIN.with_part("lag"))
    narrow.fundamental, wide.fundamental = (1.0, 10), (1 - lower / 10, 10)
    assert _fundamentals_are_alike(narrow, wide) == alike


@pytest.mark.parametrize(("c", "missing"), [(0.002, 0.2), (0.02, 1.0)])
def test_a_link_mode_lacks_its_further_terms(c: float, missing: float) -> None:
    """The share ω²c/J of them at the highest frequency, at most all; K and D follow c linearly."""
    found = estimate(PLAIN.with_part("link"), link=c)
    found.phasors = SimpleNamespace(omega=np.array([3.0, 10.0]))
    found.covariance = np.array([[4.0, 0, 1.5], [0, 1, -0.5], [1.5, -0.5, 2.0]])
    prior: Any = SimpleNamespace(link_inertia=np.ones(1), link_std=lambda *_: np.full(1, 0.5))
    shift = np.array([1.5, -0.5]) / 2.0 * c * missing
    np.testing.assert_allclose(spread_of_modes(found, prior), np.outer(shift, shift))
    found.covariance[0, 2] = np.inf
    assert not spread_of_modes(found, prior).any()


# --- the search


def search_of(
    tried: dict[Model, Any] | None = None,
    optional: tuple[str, ...] = (),
    phasors: Any = None,
    poses: int = 1,
    **parts: Any,
) -> Search:
    """A search with these models, in phasors of sines."""
    prior: Any = SimpleNamespace(M2=np.zeros(poses), of_rows=lambda rows: ("prior", rows.tolist()))
    noise: Any = Noise(np.zeros((24, 1, 4, 4), complex), np.arange(24.0))
    start: Any = parts.pop("start", None)
    return Search(phasors, prior, start, noise, PLAIN, Fits(optional, ROWS, tried or {}), **parts)


def sines(frequencies: np.ndarray, joints: int = 2) -> Any:
    none = np.ones((frequencies.size, joints), complex)
    return exact_phasors(frequencies, none, none)


@pytest.mark.parametrize(
    ("count", "each", "kept"), [(29, 1, 29), (30, 1, 20), (60, 1, 20), (32, 2, 20), (40, 4, 20)]
)
def test_a_model_is_sought_in_ten_records_per_joint(count: int, each: int, kept: int) -> None:
    """Of evenly spread frequencies, with all of their records; in all if there are several poses."""
    frequencies = np.repeat(np.geomspace(1, 30, count // each), each)[::-1]
    phasors = sines(frequencies)
    rows = search_of(phasors=phasors).few_rows()
    assert rows.size == kept
    chosen = frequencies[rows]
    assert {chosen.max(), chosen.min()} == {frequencies.max(), frequencies.min()}
    assert all(np.count_nonzero(chosen == f) == each for f in chosen)
    steps = np.diff(np.unique(np.searchsorted(np.unique(frequencies), np.unique(chosen))))
    assert np.ptp(steps) <= 1
    assert search_of(phasors=phasors, poses=2).few_rows().size == count
    assert search_of(phasors=phasors).few_rows(100).size == count


@pytest.mark.parametrize(("misfit", "fitted"), [(1.0, True), (2.0, False)])
def test_a_law_that_explains_motions_is_pruned_beyond_the_limit_on_fits(
    misfit: float, fitted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With an uncertain part it could not be chosen: a wrong law was, with K off by 140 %."""
    both = PLAIN.with_part("cubic").with_part("hysteresis")
    seen: list[Model] = []

    def fit_model(*given: Any, **_: Any) -> None:
        seen.append(given[4])
        raise JointIdError("does not converge")

    monkeypatch.setattr(model_search, "fit_model", fit_model)
    found = estimate(both, misfit=misfit, cubic=0.1, hysteresis=99.0, presliding=99.0)
    phasors = SimpleNamespace(motion=np.array([True]))
    search = search_of({both: found}, ("cubic", "hysteresis"), phasors, slow_fits=99)
    search._waveforms[None, False] = None
    search.pruned(both)
    assert seen == [both.without("cubic")] * fitted


def test_a_search_in_some_rows_has_their_noise_and_equations() -> None:
    search = search_of(phasors=sines(np.arange(1.0, 25)), optional=("lag",), first=(RUBBING,))
    few = search.of_rows(np.array([3, 5, 9]))
    assert few.phasors.frequency_found_hz.tolist() == [4.0, 6.0, 10.0]
    assert few.noise.degrees_of_freedom.tolist() == [3.0, 5.0, 9.0]
    assert few.prior == ("prior", [3, 5, 9])
    assert (few.fits.rows, few.fits.optional) == (ROWS * 3 // 24, ("lag",))
    assert (few.base, few.first) == (PLAIN, (RUBBING,))
    search.starts[PLAIN], search.slow_fits = 1, 3
    again = search.again("elsewhere")  # type: ignore[arg-type]
    assert (again.start, again.starts, again.slow_fits) == ("elsewhere", {}, 0)
    assert again.fits.tried == {}


def test_a_search_ends_after_24_fits_or_48_near_the_data_and_a_model_after_two_starts() -> None:
    search = search_of({PLAIN: estimate(misfit=99.0), RUBBING: estimate(RUBBING, misfit=101.0)})
    assert search.is_open(RUBBING)
    assert not search.is_open(PLAIN)  # it converged
    assert search.is_open(FREE)
    search.starts = {RUBBING: 1}
    assert search.is_open(RUBBING)
    search.starts = {RUBBING: 2, PLAIN: 21}
    assert not search.is_open(RUBBING)
    assert not search.is_spent
    search.starts[PLAIN] = 22
    assert search.is_spent
    assert not search.is_lost
    search.fits.tried[PLAIN].misfit = 3.1
    assert search.is_spent
    search.fits.tried[PLAIN].misfit = 2.9  # growth part by part takes more
    assert not search.is_spent
    search.starts[PLAIN] = 46
    assert search.is_spent
    search.fits.tried[PLAIN].misfit = 100.0
    assert search.is_lost
    assert search_of().is_lost


@pytest.mark.parametrize(
    ("misfit", "chance", "moves", "richer"),
    [
        (1.1, 1.1e-3, False, False),
        (1.11, 0.5, False, True),
        (1.0, 0.9e-3, False, True),
        (1.3, 1e-9, True, False),
        (1.31, 0.5, True, True),
    ],
)
def test_a_model_may_be_richer_where_noise_does_not_explain_it(
    misfit: float, chance: float, moves: bool, richer: bool
) -> None:
    phasors: Any = SimpleNamespace(motion=np.array([moves]))
    found = estimate(misfit=misfit, chance=chance)
    assert search_of(phasors=phasors).may_be_richer(found) == richer


@pytest.mark.parametrize(("cost", "little"), [(14.2, False), (14.6, True)])
def test_a_fit_that_leaves_a_third_of_the_torques_explains_little(cost: float, little: bool) -> None:
    """The squares of the torques are 130 times their noise; those without noise do not count."""
    phasors = sines(np.array([1.0]))
    z = np.array([[[1.0, 1.0, 4.0, 3j], [1.0, 1.0, 2.0, 5.0]]])
    variance = np.array([[1.0, 1, 0.2, 0.2], [1, 1, 0.8, 0.0]])
    covariance = (variance[..., None] * np.eye(4))[None].astype(complex)
    phasors = replace(phasors, harmonics=z, harmonic_covariance=covariance)
    tried = {PLAIN: estimate(cost=cost, misfit=5.0), RUBBING: estimate(RUBBING, cost=1e9, misfit=6.0)}
    assert search_of(tried, phasors=phasors).explains_little == little
    assert not search_of(phasors=phasors).explains_little
    assert not search_of({PLAIN: JointIdError("")}, phasors=phasors).explains_little


@pytest.mark.parametrize(
    ("part", "moves", "share", "worth"),
    [
        ("arm_viscous", False, 0.0, True),  # a quick fit
        ("arm_viscous", True, 0.49, False),
        ("arm_viscous", True, 0.51, True),
        ("cubic", False, 0.14, False),
        ("cubic", False, 0.16, True),
        ("lag", True, 0.14, False),
        ("lag", True, 0.16, True),
    ],
)
def test_a_slow_part_far_from_the_data_must_explain_much(
    monkeypatch: pytest.MonkeyPatch, part: str, moves: bool, share: float, worth: bool
) -> None:
    phasors: Any = SimpleNamespace(motion=np.array([moves]))
    search = search_of({PLAIN: estimate(cost=200.0, misfit=101.0)}, phasors=phasors)
    monkeypatch.setattr(Search, "scores", lambda *_: {part: SimpleNamespace(gain=share * 200.0)})
    assert search.may_explain(PLAIN, part) == worth
    monkeypatch.setattr(Search, "scores", lambda *_: {})
    assert search.may_explain(PLAIN, part) == (share == 0)
    search.fits.tried[PLAIN].misfit = 99.0
    assert search.may_explain(PLAIN, part)
    assert search.may_explain(RUBBING, part)


def test_laws_start_from_regressions_that_leave_least(monkeypatch: pytest.MonkeyPatch) -> None:
    """Slopes imitate other laws: they count twice."""
    left = {"cubic": 0.3, "backlash": 0.2, "piecewise": 0.14}
    monkeypatch.setattr(model_search, "by_regression", lambda law, *_: (f"by {law}", left[law]))
    found = search_of(optional=("cubic", "backlash")).regressed_laws
    assert found == [("backlash", "by backlash", 0.2), ("piecewise", "by piecewise", 0.28),
                     ("cubic", "by cubic", 0.3)]  # fmt: skip
    assert [law for law, *_ in search_of(optional=("backlash",)).regressed_laws] == ["backlash"]
    monkeypatch.setattr(model_search, "by_regression", lambda *_: None)
    assert search_of(optional=("cubic", "backlash")).regressed_laws == []


def test_uncertain_parts_are_left_out_in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    model = Model(0.0, delay=False, effects=("lag", "gravity"))
    certain = {"coulomb": True, "friction": False, "lag": False, "gravity": True}
    monkeypatch.setattr(Fits, "is_certain", lambda self, model, part: certain[part])
    search = search_of(optional=("friction", "lag", "gravity"))
    without = [model.without("friction"), model.without("lag")]
    assert list(search._narrower(model)) == without
    certain["coulomb"] = False
    assert list(search._narrower(model)) == [model.with_part("viscous"), *without]
    search.fits.optional += ("delay",)
    certain["lag"] = True
    late = model.without("lag").with_part("delay")
    assert list(search._narrower(model)) == [model.with_part("viscous"), without[0], late]
    search.fits.optional = ("gravity",)
    assert list(search._narrower(model)) == []


# --- fits of one model


@pytest.mark.parametrize(
    ("optional", "changed", "found"),
    [
        (("friction", "delay", "lag"), {}, Model(0.03, delay=False, effects=("lag",))),
        (("friction", "delay"), {}, Model(0.03, delay=True)),
        (("friction",), {}, Model(0.03, delay=False)),
        (("delay", "lag"), {}, PLAIN),
        (("friction", "delay", "lag"), {"joints": 1}, Model(0.03, delay=True)),
        (("friction", "delay", "lag"), {"moves": True}, Model(0.03, delay=True)),
        (("friction", "delay", "lag"), {"H": 1}, PLAIN),
        (("friction", "lag"), {"base": Model(None, delay=True)}, Model(0.03, delay=True)),
    ],
)
def test_the_freest_model_has_free_friction_and_delays(
    optional: tuple[str, ...], changed: dict[str, Any], found: Model
) -> None:
    """Lags of sines with several joints; nothing free without harmonics."""
    harmonics = np.zeros((2, changed.get("H", 3), 4))
    motion = np.array([False, changed.get("moves", False)])
    phasors: Any = SimpleNamespace(harmonics=harmonics, n=changed.get("joints", 2), motion=motion)
    assert model_fits.freest(phasors, changed.get("base", PLAIN), optional) == found


@pytest.mark.parametrize(
    ("misfits", "taken", "fitted"),
    [
        ({"given": 2.9, "free": 1.0}, 2.9, ["given"]),
        ({"given": 3.1, "free": 1.0}, 1.0, ["given", "free"]),
        ({"given": 3.1, "free": 4.0}, 3.1, ["given", "free"]),
        ({"free": 4.0}, 4.0, ["given", "free"]),
        ({}, None, ["given", "free"]),
    ],
)
def test_a_fit_starts_without_the_given_inertias_where_they_do_not_explain_the_data(
    monkeypatch: pytest.MonkeyPatch, misfits: dict[str, float], taken: float | None, fitted: list[str]
) -> None:
    tried = []

    def fit(*arguments: Any) -> Any:
        tried.append(start := arguments[2])
        if start not in misfits:
            raise JointIdError("no fit")
        return SimpleNamespace(misfit=misfits[start])

    monkeypatch.setattr(model_fits, "fit_model", fit)
    monkeypatch.setattr(model_fits, "without_inertias", lambda *_: "free")
    one: Any = None
    found = model_fits.fit_without_inertias(one, one, "given", one, PLAIN)  # type: ignore[arg-type]
    assert (None if found is None else found.misfit) == taken
    assert tried == fitted
    monkeypatch.setattr(model_fits, "without_inertias", lambda *_: None)
    tried.clear()
    model_fits.fit_without_inertias(one, one, "given", one, PLAIN)  # type: ignore[arg-type]
    assert tried == ["given"]


def fits_of(
    monkeypatch: pytest.MonkeyPatch, costs: dict[Any, tuple[float, float]]
) -> list[tuple[Model, Any]]:
    """Replace fits by costs and misfits of their starts; returns the list of those that were made."""
    made: list[tuple[Model, Any]] = []

    def fit(*arguments: Any) -> Any:
        start, model = arguments[2], arguments[4]
        made.append((model, start))
        if start not in costs:
            raise JointIdError("no fit")
        cost, misfit = costs[start]
        named = SimpleNamespace(start=start)
        return SimpleNamespace(
            cost=cost, misfit=misfit, named=named, whole_cost=lambda misfit: cost / misfit
        )

    monkeypatch.setattr(model_search, "fit_model", fit)
    monkeypatch.setattr(Search, "waveforms", lambda *_: None)
    monkeypatch.setattr(model_search, "other_laws", lambda *_, is_near: ())
    monkeypatch.setattr(model_search, "by_regression", lambda *_: None)
    monkeypatch.setattr(model_search, "with_one_bend", lambda _: None)
    monkeypatch.setattr(Model, "imitates_other_law", lambda *_: False)
    return made


def test_of_two_starts_the_better_fit_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    made = fits_of(monkeypatch, {"a": (50.0, 1.0), "b": (40.0, 1.0), "c": (60.0, 1.0)})
    search = search_of(phasors=sines(np.ones(1)))
    for start, cost in (("a", 50.0), ("c", 50.0), ("b", 40.0), ("none", 40.0)):
        search.fit(PLAIN, start)  # type: ignore[arg-type]
        assert search.fits.estimate(PLAIN).cost == cost  # type: ignore[union-attr]
    assert search.starts[PLAIN] == len(made) == 4
    search.fit(RUBBING, "none")  # type: ignore[arg-type]
    assert search.fits.estimate(RUBBING) is None
    assert RUBBING in search.fits.tried


@pytest.mark.parametrize(
    ("law", "misfit", "tried"),
    [
        ("cubic", 2.9, []),
        ("cubic", 3.1, ["far", "near"]),
        ("cubic", 9.9, ["far", "near"]),
        ("cubic", 10.1, ["far"]),
        ("hysteresis", 1.09, []),
        ("hysteresis", 1.11, ["far", "near"]),
    ],
)
def test_a_doubtful_law_starts_again_elsewhere(
    monkeypatch: pytest.MonkeyPatch, law: str, misfit: float, tried: list[str]
) -> None:
    costs = {"start": (100.0, misfit), "far": (120.0, misfit), "near": (99.0, misfit)}
    made, model = fits_of(monkeypatch, costs), PLAIN.with_part(law)
    monkeypatch.setattr(
        model_search, "other_laws", lambda *_, is_near: ("near",) if is_near else ("far",)
    )
    search = search_of(phasors=sines(np.ones(1)))
    search.fit(model, "start")  # type: ignore[arg-type]
    assert [start for _, start in made] == ["start", *tried]
    best = search.fits.estimate(model)
    assert best is not None
    assert best.cost == (99.0 if "near" in tried else 100.0)


@pytest.mark.parametrize(
    ("misfit", "tried"), [(3.0, []), (3.1, ["regression"]), (100.0, ["regression"]), (101.0, [])]
)
def test_a_law_starts_from_its_regression_once(
    monkeypatch: pytest.MonkeyPatch, misfit: float, tried: list[str]
) -> None:
    made = fits_of(monkeypatch, {"start": (100.0, misfit), "regression": (90.0, 1.0)})
    monkeypatch.setattr(model_search, "by_regression", lambda law, *_: ("regression", 0.1))
    model = PLAIN.with_part("cubic")
    for moves in (False, True):
        phasors = sines(np.ones(1))
        still = [SimpleNamespace()] if moves else []
        search = search_of(phasors=replace(phasors, segments=tuple(still)), optional=("cubic",))
        made.clear()
        search.fit(model, "start")  # type: ignore[arg-type]
        assert [start for _, start in made] == ["start", *(tried if not moves else [])]
        search.fit(model, "start")  # type: ignore[arg-type]
        assert len(made) == 2 + len(tried) * (not moves)


@pytest.mark.parametrize(
    ("misfit", "cost", "taken"), [(2.9, 103.9, True), (2.9, 104.1, False), (3.1, 50.0, False)]
)
def test_one_change_of_slope_is_taken_at_about_the_same_cost(
    monkeypatch: pytest.MonkeyPatch, misfit: float, cost: float, taken: bool
) -> None:
    fits_of(monkeypatch, {"start": (100.0, misfit), "apart": (cost, misfit)})
    monkeypatch.setattr(model_search, "with_one_bend", lambda _: "apart")
    search, model = search_of(phasors=sines(np.ones(1))), PLAIN.with_part("piecewise")
    search.fit(model, "start")  # type: ignore[arg-type]
    found = search.fits.estimate(model)
    assert found is not None
    assert found.cost == (cost if taken else 100.0)


@pytest.mark.parametrize(("misfit", "kept"), [(1.0, False), (2.9, False), (3.1, True)])
def test_slopes_that_imitate_backlash_are_no_fit(
    monkeypatch: pytest.MonkeyPatch, misfit: float, kept: bool
) -> None:
    """Far from the data they may imitate a part that is still missing."""
    fits_of(monkeypatch, {"start": (100.0, misfit)})
    monkeypatch.setattr(Model, "imitates_other_law", lambda *_: True)
    search, model = search_of(phasors=sines(np.ones(1))), PLAIN.with_part("piecewise")
    search.fit(model, "start")  # type: ignore[arg-type]
    assert (search.fits.estimate(model) is not None) == kept


def test_fits_of_gear_laws_are_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twelve of sines; nine of motions, with four sets of laws and slopes in addition."""
    made = fits_of(monkeypatch, {"start": (100.0, 1.0)})
    laws = [("cubic",), ("backlash",), ("hysteresis",), ("cubic", "backlash"), ("cubic", "hysteresis")]
    for moves, most in ((False, 12), (True, 9)):
        phasors = replace(sines(np.ones(1)), segments=(SimpleNamespace(),) if moves else ())
        search = search_of(phasors=phasors)
        made.clear()
        for _ in range(14):
            search.fit(PLAIN.with_part("cubic"), "start")  # type: ignore[arg-type]
            search.fit(PLAIN, "start")  # type: ignore[arg-type]
        assert sum(model.is_slow for model, _ in made) == most
        search.fit(Model(0.0, delay=False, effects=("backlash",)), "start", compares=False)  # type: ignore[arg-type]
        assert sum(model.is_slow for model, _ in made) == most + (not moves)
        search, _ = search_of(phasors=phasors), made.clear()
        for effects in laws:
            search.fit(Model(None, delay=False, effects=effects), "start")  # type: ignore[arg-type]
        assert len(made) == (4 if moves else 5)
        refused = search.fits.tried[Model(None, delay=False, effects=laws[4])]
        assert isinstance(refused, JointIdError) == moves
        search.fit(PLAIN.with_part("piecewise"), "start")  # type: ignore[arg-type]
        assert made[-1][0] == PLAIN.with_part("piecewise")
        search.fit(Model(None, delay=True, effects=("cubic",)), "start")  # type: ignore[arg-type]
        assert made[-1][0].delay  # beside the same laws


@pytest.mark.parametrize(("shift", "fitted"), [(0.05, False), (0.2, True)])
def test_a_quick_part_is_fitted_to_many_rows_of_motions_where_it_moves_K(
    shift: float, fitted: bool
) -> None:
    """Their noise is that of the residual: viscous friction moved K by 19 errors unfitted."""
    phasors: Any = SimpleNamespace(motion=np.ones(3, bool))
    search = search_of({PLAIN: estimate(cost=1e4)}, phasors=phasors)
    search.fits.rows = 20_000
    part: Any = SimpleNamespace(gain=80.0, possible=(80.0, np.array([shift, 0.0])))
    assert model_growth._is_promising(search, PLAIN, part, "viscous") == fitted
    assert not model_growth._is_promising(search, PLAIN, part, "cubic")


@pytest.mark.parametrize(
    ("joints", "costs", "taken", "fitted"),
    [
        (3, {"start": (90.0, 1.24)}, "start", 1),  # explains the data
        (3, {"start": (90.0, 1.3), 1.0: (90.5, 1.3)}, "start", 2),  # twice the same minimum
        (3, {"start": (92.0, 1.3), 1.0: (90.0, 1.3), 3.0: (90.5, 1.3)}, 1.0, 3),
        (3, {"start": (90.0, 1.3), 1.0: (80.0, 1.3), 10.0: (70.0, 1.3), 0.3: (60.0, 1.3)}, 0.3, 5),
        (2, {"start": (90.0, 1.3), 1.0: (80.0, 1.3)}, "start", 1),
        (3, {}, "start", 5),
    ],
)
@pytest.mark.parametrize("loose", [False, True])
def test_held_joints_are_fitted_until_two_starts_agree(
    monkeypatch: pytest.MonkeyPatch,
    joints: int,
    costs: dict[Any, Any],
    taken: Any,
    fitted: int,
    loose: bool,
) -> None:
    """With uncertain inertias each fit has exact ones first."""
    tried: list[tuple[Any, str]] = []

    def fit(_: Any, prior: str, near: Any, *__: Any) -> Any:
        tried.append((near, prior))
        if near not in costs:
            raise JointIdError("no fit")
        cost, misfit = costs[near]
        return SimpleNamespace(misfit=misfit, named=near, whole_cost=lambda misfit: cost / misfit)

    monkeypatch.setattr(model_fits, "fit_model", fit)
    monkeypatch.setattr(model_fits, "regressed", lambda *_, stiff: (stiff, 1.0))
    exact: Any = "exact"
    prior: Any = "loose" if loose else exact
    one: Any = SimpleNamespace(n=joints)
    found = model_fits._start_with_held(one, prior, exact, "start", one, PLAIN)  # type: ignore[arg-type]
    assert found == taken
    assert sum(prior == "exact" for _, prior in tried) == fitted
    again = [near for near, prior in tried if prior == "loose"]
    assert again == [near for near in costs if loose and costs[near][1] > 1.25][: len(again)]
    assert bool(again) == (loose and any(misfit > 1.25 for _, misfit in costs.values()))


@pytest.mark.parametrize(
    ("moves", "model", "beyond", "of_K", "of_D"),
    [
        (False, PLAIN, 0.0, 0.0, 0.0),
        (False, PLAIN.with_part("piecewise"), 0.0, 1e-4, 3e-4),
        (False, PLAIN.with_part("loss_factor"), 0.0, 1e-4, 3e-4),
        (False, PLAIN.with_part("cubic"), 0.0, 0.0, 0.0),
        (True, RUBBING, 0.0, 0.0, 0.0),
        (True, PLAIN.with_part("loss_factor"), 0.0, 0.0, 0.0),
        (True, PLAIN.with_part("cubic"), 1.0, 2e-4, 1e-3),
        (True, PLAIN.with_part("hysteresis"), 4.0, 2e-4, 1e-3),
        (True, PLAIN.with_part("arm_coulomb"), 1.0, 2e-4, 1e-3),
        (True, replace(RUBBING, curve=True), 0.0, 2e-4, 1e-3),
        (True, replace(RUBBING, curve=True).with_part("motor_presliding"), 4.0, 2e-4, 1e-3),
        (True, RUBBING.with_part("motor_presliding"), 0.0, 0.0, 0.0),
        (True, replace(RUBBING, curve=True).with_part("cubic"), 1.0, 2e-4, 1e-3),
        (True, PLAIN.with_part("link"), 0.0, 0.0, 0.0),
    ],
)
def test_the_accuracy_of_waveforms_is_part_of_the_error(
    monkeypatch: pytest.MonkeyPatch, moves: bool, model: Model, beyond: float, of_K: float, of_D: float
) -> None:
    """Beside the spread of other models, of reversals in motions, of link modes and of unseen parts."""
    found, scored = estimate(model), {"link": 1.0, "lag": 2.0}
    used: list[Any] = []

    def unseen(_: Any, scored: dict[str, float], prior: Any) -> Any:
        used.extend(scored)
        return np.diag([1e-8, 2e-8])

    monkeypatch.setattr(model_selection, "spread", lambda *_: np.diag([1e-7, 2e-7]))
    monkeypatch.setattr(model_selection, "spread_of_modes", lambda *_: np.diag([1e-6, 2e-6]))
    monkeypatch.setattr(model_selection, "spread_of_reversals", lambda *_: np.diag([1e-5, 2e-5]))
    monkeypatch.setattr(model_selection, "spread_of_unseen", unseen)
    search: Any = SimpleNamespace(
        fits=SimpleNamespace(tried={model: found}, candidates=lambda best: ("candidates", best)),
        scores=lambda _: scored, has_motions=moves, prior=None, phasors=SimpleNamespace(n=1),
    )  # fmt: skip
    choice = model_selection._choice(search, model)
    parts = 1e-7 + 1e-8 + 1e-6 * ("link" in model.effects) + 1e-5 * moves
    expected = np.array([1.0, 2.0]) * parts + beyond * np.array([0.1, 0.01]) ** 2
    expected += (np.array([of_K, of_D]) * [20.0, 0.1]) ** 2
    np.testing.assert_allclose(choice.spread, np.diag(expected), rtol=1e-9)
    assert used == (["lag"] if moves else ["link", "lag"])
    assert (choice.model, choice.candidates) == (model, ("candidates", model))
    refused = JointIdError("no fit")
    search.fits.tried[model] = refused
    assert model_selection._choice(search, model).estimate is refused
