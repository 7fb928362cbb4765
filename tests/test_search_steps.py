"""Steps of the search for a model, each replaced by a change of the misfit that it leaves."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plants import ROBOTS

from jointid import Elasticity, Inertia, JointIdError, resonances
from jointid.estimation import model_climb, model_growth, model_selection, motion_noise
from jointid.estimation.candidates import Model
from jointid.estimation.estimators import maximum_likelihood
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.maximum_likelihood import LikelihoodEstimate
from jointid.estimation.estimators.parameters import ParameterLayout
from jointid.estimation.estimators.score_tests import _RIDGE, Score, _further_step
from jointid.estimation.identify_motion import _highest_hz
from jointid.estimation.model_average import _squares_by_orders, spread_of_accuracy
from jointid.estimation.model_climb import fit_first, freed
from jointid.estimation.model_growth import _clear_parts, _without_insignificant
from jointid.estimation.model_selection import _searched_in_few
from jointid.estimation.motion_noise import _fit_from
from jointid.motion.per_turn import PerTurn

RIGID, SLIDING = Model(None, delay=False), Model(0.0, delay=False)
STEPS = (
    "fit_first",
    "fit_periodic",
    "climb_from_first",
    "fit_regressed",
    "climb_from_nearest",
    "fit_hanging",
    "fit_laws",
    "fit_complete",
)


class Script:
    """A search whose misfit is set by its steps: ``left`` after a step of this name."""

    def __init__(self, start: float, left: dict[str, float], **facts: Any) -> None:
        self.misfit, self.left, self.done = start, left, list[str]()
        given = {
            "has_motions": False, "may_have_friction": True, "is_distorted": False, "first": (),
            "explains_little": False, "far": 10.0, "wrong": False, "contradicted": False, "few": 4,
            "impossible": False, "wrong_inertias": False,
        }  # fmt: skip
        self.__dict__.update(given | facts)
        self.phasors = SimpleNamespace(omega=np.ones(4), z=None, covariance=None)
        self.base, self.start = RIGID, "start"

    @property
    def fits(self) -> Any:
        return SimpleNamespace(
            least_misfit=self.misfit, tried={RIGID: 1}, misfit=lambda _: self.misfit,
            least=lambda *_: "least", estimate=lambda _: 1,
        )  # fmt: skip

    @property
    def is_lost(self) -> bool:
        return not self.misfit < 100.0

    def fit(self, *_: Any) -> None:
        self.step("fit")

    def gives_up(self) -> bool:
        return bool(self.__dict__["wrong"])

    def gives_up_late(self) -> bool:
        return bool(self.__dict__["contradicted"])

    def few_rows(self) -> np.ndarray:
        return np.arange(self.__dict__["few"])

    def pruned(self, best: Any) -> Any:
        return best

    def step(self, name: str) -> bool:
        self.done.append(name)
        self.misfit = self.left.get(name, self.misfit)
        return False


def searched(monkeypatch: pytest.MonkeyPatch, script: Script) -> list[str]:
    for name in STEPS:
        monkeypatch.setattr(model_selection, name, lambda search, *_, name=name: search.step(name))
    ends = {"_choice": "chosen", "_given_up": "given up", "_searched_in_few": "searched in few"}
    for name, said in ends.items():
        monkeypatch.setattr(model_selection, name, lambda search, *_, said=said: search.step(said))
    impossible = 1e3 if script.__dict__["impossible"] else 1.0
    monkeypatch.setattr(model_selection, "least_misfit", lambda *_: impossible)
    monkeypatch.setattr(model_selection, "_loosened", lambda _: None)
    wrong = script.__dict__["wrong_inertias"]
    monkeypatch.setattr(model_selection, "_inertias_are_wrong", lambda *_: wrong)
    monkeypatch.setattr(model_selection, "_best", lambda search: search.step("best"))
    monkeypatch.setattr(model_selection, "with_best_orders", lambda _, best: best)
    other = Script(script.left.get("elsewhere", 1e9), {})
    monkeypatch.setattr(model_selection, "_other_start", lambda search: [search.step("other"), other][1])
    model_selection._searched(script)  # type: ignore[arg-type]
    return script.done + [f"other {name}" for name in other.done]


NEAR = ["fit_first", "fit_periodic", "fit_regressed", "fit_laws", "best", "fit_periodic", "chosen"]
FAR_OFF = ["fit_first", "fit_periodic", "fit_regressed", "climb_from_nearest", "fit_hanging", "fit_laws"]


@pytest.mark.parametrize(
    ("start", "left", "facts", "steps"),
    [
        (2.0, {}, {}, NEAR),
        (2.0, {}, {"impossible": True}, ["fit", "chosen"]),
        (50.0, {}, {"wrong": True}, ["fit_first", "given up"]),
        (9.0, {}, {"wrong": True}, NEAR),
        (5e3, {}, {"contradicted": True}, [*FAR_OFF, "chosen"]),
        (50.0, {}, {"wrong_inertias": True}, ["fit_first", "chosen"]),
        (5e3, {}, {"wrong_inertias": True}, ["fit_first", "fit_regressed", "chosen"]),
        (5e3, {"fit_laws": 3.0}, {"contradicted": True}, [*FAR_OFF, *NEAR[4:]]),
        (5e3, {}, {"few": 3}, ["fit_first", "fit_periodic", "searched in few"]),
        (99.0, {}, {"few": 3}, NEAR),
        (5e3, {"fit_regressed": 3.0}, {}, NEAR),
        (5e3, {"climb_from_nearest": 3.0}, {}, [*FAR_OFF[:4], *NEAR[3:]]),
        (
            5e3, {"climb_from_first": 3.0}, {"is_distorted": True},
            [*NEAR[:2], "climb_from_first", *NEAR[2:]],
        ),
        (5e3, {"fit_laws": 3.0}, {}, [*FAR_OFF, *NEAR[4:]]),
        (5e3, {"fit_laws": 3.0, "fit_hanging": 4e2}, {},
         [*FAR_OFF[:5], "climb_from_nearest", "fit_laws", *NEAR[4:]]),
        (5e3, {"fit_complete": 3.0}, {}, [*FAR_OFF, "fit_complete", *NEAR[4:]]),
        (5e3, {}, {"explains_little": True}, [*FAR_OFF, "other", "chosen"]),
        (5e3, {}, {}, [*FAR_OFF, "fit_complete", "other", *NEAR[4:]]),
        (5e3, {}, {"first": ("a model",)},
         ["fit", *FAR_OFF, "fit_complete", *NEAR[4:]]),
        (5e3, {"elsewhere": 2.0}, {},
         [*FAR_OFF, "fit_complete", "other", "other fit_first", "other fit_laws",
          *(f"other {name}" for name in NEAR[4:])]),
        (5e3, {"fit_laws": 2.0}, {"has_motions": True},
         ["fit_first", "fit_regressed", "fit_hanging", *NEAR[3:]]),
    ],
)  # fmt: skip
def test_steps_are_taken_while_no_model_comes_near_the_data(
    monkeypatch: pytest.MonkeyPatch,
    start: float,
    left: dict[str, float],
    facts: dict[str, Any],
    steps: list[str],
) -> None:
    assert searched(monkeypatch, Script(start, left, **facts)) == steps


@pytest.mark.parametrize(
    ("least", "loosened", "freest", "wrong"),
    [
        (60.0, 1.2, 55.0, True),
        (60.0, 1.2, 1.3, False),  # a lag explains them with the inertias as given
        (60.0, 4.0, 55.0, False),
        (11.0, 1.2, 11.0, False),
        (5e3, 40.0, 5e3, True),
        (5e3, 60.0, 5e3, False),
        (5e3, None, 5e3, False),
    ],
)
def test_exact_inertias_are_wrong_where_free_ones_explain_far_more(
    monkeypatch: pytest.MonkeyPatch, least: float, loosened: float | None, freest: float, wrong: bool
) -> None:
    search: Any = Script(least, {"fit": freest})
    monkeypatch.setattr(model_selection, "freest", lambda *_: RIGID)
    monkeypatch.setattr(Script, "fits", property(lambda self: SimpleNamespace(
        least_misfit=self.misfit, optional=(),
    )))  # fmt: skip
    free: Any = None if loosened is None else SimpleNamespace(misfit=loosened, named="start")
    assert model_selection._inertias_are_wrong(search, free) is wrong


@pytest.mark.parametrize(("rows", "least", "std", "tried"), [
    (26_000, 60.0, 0.0, True), (4_000, 60.0, 0.0, False), (26_000, 2.0, 0.0, False),
    (4_000, 5e3, 0.0, True), (26_000, 60.0, 0.05, False),
])  # fmt: skip
def test_free_inertias_are_tried_far_off_and_with_many_equations_sooner(
    monkeypatch: pytest.MonkeyPatch, rows: int, least: float, std: float, tried: bool
) -> None:
    fits = SimpleNamespace(rows=rows, least_misfit=least, optional=())
    prior = InertiaPrior.of(Inertia(np.ones(1), np.eye(1)), 1, 1, inertia_std=std)
    search: Any = SimpleNamespace(
        fits=fits, is_lost=least >= 100, has_motions=False, prior=prior, phasors=None, base=RIGID,
        start=None, noise=None,
    )  # fmt: skip
    monkeypatch.setattr(model_selection, "freest", lambda *_: RIGID)
    monkeypatch.setattr(model_selection, "fit_without_inertias", lambda *_: "fit")
    assert (model_selection._loosened(search) is not None) is tried


@pytest.mark.parametrize(
    ("rubs", "misfits", "dissipates", "chosen"),
    [
        (False, {RIGID: 9.0, SLIDING: 8.9}, True, RIGID),  # hardly better
        (False, {RIGID: 9.0, SLIDING: 3.0}, True, SLIDING),
        (False, {RIGID: 9.0, SLIDING: 3.0}, False, RIGID),  # friction that drives
        (False, {RIGID: 9.0}, True, RIGID),
        (False, {SLIDING: 9.0}, True, SLIDING),
        (True, {RIGID: 1.0, SLIDING: 9.0}, True, SLIDING),
        (True, {}, True, None),
    ],
)
@pytest.mark.parametrize(("late", "delayed"), [(0.1, True), (0.9, False), (None, False)])
@pytest.mark.parametrize(("step", "differs"), [(0.79, True), (0.81, False)])
def test_a_first_fit_of_motions_has_friction_and_a_delay_where_they_explain_far_more(
    monkeypatch: pytest.MonkeyPatch,
    rubs: bool,
    misfits: dict[Model, float],
    dissipates: bool,
    chosen: Model | None,
    late: float | None,
    delayed: bool,
    step: float,
    differs: bool,
) -> None:
    """``late`` is the misfit of a fit with a delay, over that without; None where it fails.

    ``step`` is that after a step towards friction that differs from segment to segment.
    """

    def fit_model(_: Any, __: Any, ___: Any, ____: Any, model: Model) -> Any:
        misfit = misfits.get(Model(model.reversal, delay=False))
        if misfit is None or (model.delay and late is None):
            raise JointIdError("no fit")
        return SimpleNamespace(misfit=misfit * (late or 1.0) if model.delay else misfit, named=None)

    monkeypatch.setattr(motion_noise, "fit_model", fit_model)
    stepped = lambda _, __, found, *___: (None, step * found.misfit)  # noqa: E731
    monkeypatch.setattr(motion_noise, "stepped", stepped)
    monkeypatch.setattr(motion_noise, "dissipates", lambda _: dissipates)
    start: Any = SimpleNamespace(layout=["coulomb"] if rubs else [])
    found = _fit_from(None, None, start, None)  # type: ignore[arg-type]
    if chosen is None:
        assert found is None
    else:
        assert found is not None
        differs &= chosen.reversal is not None
        assert found[0] == Model(chosen.reversal, delay=delayed, differs=differs)
        assert found[1].misfit == pytest.approx(misfits[chosen] * ((late or 1.0) if delayed else 1.0))


def test_a_step_against_further_parameters_is_that_of_all_together() -> None:
    """Newton's step of the whole parabola, and the decrease beside that by the base alone."""
    rng = np.random.default_rng(1)
    J, base, own = rng.standard_normal((9, 5)), np.array([0, 1, 3]), np.array([2, 4])
    normal, gradient = J.T @ J, J.T @ rng.standard_normal(9)
    inner = normal[np.ix_(base, base)]
    step, gain, through, left = _further_step(gradient, normal, inner, base, own)
    np.testing.assert_allclose(step, np.linalg.solve(normal, gradient)[own], rtol=1e-6)
    of_all = gradient @ np.linalg.solve(normal, gradient)
    of_base = gradient[base] @ np.linalg.solve(inner, gradient[base])
    assert gain == pytest.approx(of_all - of_base, rel=1e-6)
    np.testing.assert_allclose(inner @ through, normal[np.ix_(base, own)])
    np.testing.assert_allclose(np.linalg.inv(left), np.linalg.inv(normal)[np.ix_(own, own)], rtol=1e-6)


def test_a_score_is_penalised_by_half_of_schwarz_s_penalty() -> None:
    none = np.zeros(2)
    score = Score(10.0, 2, (0.0, none), none, none, none, none)
    assert score.penalised(100) == pytest.approx(10 - np.log(100))


def test_a_parameter_like_the_others_takes_a_finite_step() -> None:
    normal = np.ones((2, 2))
    *_, left = _further_step(np.ones(2), normal, normal[:1, :1], np.array([0]), np.array([1]))
    np.testing.assert_allclose(left, [[_RIDGE]])


def estimate_of(cost: float, shift: float, misfit: float = 1.0) -> Any:
    return SimpleNamespace(cost=cost, misfit=misfit, elasticity=np.array([1.0 + shift, 2.0]))


def test_other_orders_that_fit_as_well_are_part_of_the_error() -> None:
    """The largest change of K and D by models that differ by nothing but the orders."""

    def model(order: int, **more: Any) -> Model:
        of = PerTurn("ripple", (order,), (0.0,))
        return Model(0.0, delay=False, effects=("ripple",), per_turn=(of,), **more)

    best, found = model(6), estimate_of(10.0, 0.0)
    near, worse = estimate_of(10.0, 0.3), estimate_of(1e3, 5.0)
    tried = {
        best: found,
        model(5): near,
        model(7): worse,
        replace(model(5), delay=True): estimate_of(10.0, 9.0),
    }
    fits: Any = SimpleNamespace(tried=tried, estimate=tried.get)
    np.testing.assert_allclose(_squares_by_orders(fits, best, found), [0.09, 0.0])
    np.testing.assert_allclose(_squares_by_orders(fits, SLIDING, found), 0.0)


@pytest.mark.parametrize(
    ("gains", "misfit", "beside", "clear"),
    [
        ({"delay": 50.0, "gravity": 40.0, "cubic": 1.0}, 1.0, {}, ["delay", "gravity"]),
        ({"delay": 50.0, "gravity": 14.0}, 1.0, {}, ["delay"]),  # far below the highest
        ({"delay": 50.0, "gravity": 40.0}, 1.0, {"delay": 0.1, "gravity": 50.0}, ["gravity"]),
        ({"delay": 50.0, "gravity": 40.0}, 1.0, {"delay": 0.1}, ["gravity"]),
        ({"delay": 50.0, "gravity": 40.0}, 1.2, {"delay": 0.1}, ["delay", "gravity"]),  # not explained
        ({"delay": 9.5, "gravity": 8.0}, 1.2, {}, []),  # less than a tenth of what is left
        ({"delay": 12.0, "gravity": 8.0}, 1.2, {}, ["delay"]),
    ],
)
def test_clear_parts_are_significant_also_beside_free_reversals(
    gains: dict[str, float], misfit: float, beside: dict[str, float], clear: list[str]
) -> None:
    """100 above the expected cost; free reversals are tried where friction explains the data."""
    free, fitted = replace(SLIDING, reversal=0.03), list[Model]()

    def scores(model: Model) -> dict[str, Any]:
        own = beside if model == free else gains
        return {
            name: SimpleNamespace(gain=gain, count=1, penalised=lambda _, gain=gain: gain)
            for name, gain in own.items()
        }

    fits = SimpleNamespace(optional=("delay", "gravity"), rows=100, tried={}, misfit=lambda _: 1.0)
    search: Any = SimpleNamespace(
        fits=fits, scores=scores, is_full=lambda _: False, has_motions=False,
        fit=lambda model, _: fitted.append(model),
    )  # fmt: skip
    found: Any = SimpleNamespace(cost=110.0, expected_cost=10.0, misfit=misfit, named=None)
    assert _clear_parts(search, SLIDING, found) == clear
    assert fitted == ([free] if misfit < 1.1 and gains else [])
    fitted.clear()
    _clear_parts(search, RIGID, found)  # without friction
    assert not fitted


@pytest.mark.parametrize(
    ("of_few", "lost", "late", "found", "steps"),
    [
        (50.0, True, False, "least", []),  # no model explains some records, hence none all
        (3.0, False, False, "best", ["fit"]),
        (3.0, True, True, "least", ["fit"]),
        (3.0, True, False, "least", ["fit", "climb"]),
    ],
)
def test_a_model_of_few_records_is_the_start_for_all(
    monkeypatch: pytest.MonkeyPatch, of_few: float, lost: bool, late: bool, found: str, steps: list[str]
) -> None:
    done: list[str] = []
    estimate = object.__new__(LikelihoodEstimate)
    object.__setattr__(estimate, "p", np.zeros(2))
    object.__setattr__(estimate, "layout", SimpleNamespace(named=lambda p: "near"))
    chosen = SimpleNamespace(model=SLIDING, estimate=estimate)
    few = SimpleNamespace(fits=SimpleNamespace(least_misfit=of_few), has_two_laws=True)

    def fit(model: Model, near: Any, *, compares: bool) -> None:
        assert (model, near, compares) == (SLIDING, "near", False)
        done.append("fit")

    search: Any = SimpleNamespace(
        fits=SimpleNamespace(least=lambda: "least"), of_rows=lambda rows: few, most=10.0, fit=fit,
        is_lost=lost, gives_up_late=lambda: late, has_two_laws=False,
    )  # fmt: skip
    monkeypatch.setattr(model_selection, "_searched", lambda _: chosen)
    monkeypatch.setattr(model_selection, "_choice", lambda _, model: model)
    monkeypatch.setattr(model_selection, "_best", lambda _: "best")
    monkeypatch.setattr(model_selection, "climb_from_nearest", lambda *_: done.append("climb"))
    assert _searched_in_few(search, np.arange(3)) == found  # type: ignore[comparison-overlap]
    assert done == steps
    assert search.has_two_laws


LATE_SLIDING = Model(0.0, delay=True)
FREE, WIDE, LATE = (
    replace(SLIDING, reversal=0.03),
    replace(SLIDING, reversal=0.1),
    Model(None, delay=True),
)
OWN = replace(FREE, differs=True)


def growing(misfits: dict[Model, float], **facts: Any) -> tuple[Any, list[Any]]:
    """A search whose fits have these misfits, and its fits: models, with the name of another start."""
    done: list[Any] = []
    tried: dict[Model, Any] = {}

    def fit(model: Model, start: str, *, compares: bool = True) -> None:
        done.append(model if start == "start" else (model, start))
        misfit = misfits.get(model, 1e4)
        tried[model] = SimpleNamespace(misfit=misfit, cost=misfit, named="near")

    class Search(SimpleNamespace):
        @property
        def is_lost(self) -> bool:
            return not min((each.misfit for each in tried.values()), default=np.inf) < 100.0

    class Start(str):
        layout = ("coulomb",) if facts.get("coulomb") else ()

    fits = SimpleNamespace(
        tried=tried, estimate=tried.get, optional=("delay", "friction", "load"),
        misfit=lambda model: tried[model].misfit if model in tried else np.inf,
        is_certain=lambda *_: facts.get("certain", True),
    )  # fmt: skip
    given = {"is_distorted": False, "may_have_friction": True, "has_motions": False, "first": ()} | facts
    search = Search(
        fits=fits, start=Start("start"), base=RIGID, fit=fit, free_start=lambda: ["other"],
        may_be_richer=lambda _: True, may_explain=lambda *_: True, **given,
    )  # fmt: skip
    return search, done


def gains(**parts: float) -> dict[str, Any]:
    return {part: SimpleNamespace(gain=gain) for part, gain in parts.items()}


@pytest.mark.parametrize(
    ("misfits", "facts", "fitted"),
    [
        ({RIGID: 1.0}, {}, [RIGID]),
        ({RIGID: 4.0}, {}, [RIGID, (RIGID, "other")]),
        ({RIGID: 4.0}, {"is_distorted": True, "may_have_friction": False}, [RIGID]),
        ({RIGID: 5e3}, {}, [RIGID, (RIGID, "other"), LATE, SLIDING]),
        ({RIGID: 5e3, LATE: 2.0}, {}, [RIGID, (RIGID, "other"), LATE]),
        ({SLIDING: 3.0}, {"is_distorted": True}, [SLIDING]),
        ({SLIDING: 1e3, FREE: 2.0}, {"is_distorted": True}, [SLIDING, (FREE, "near")]),
        (
            {SLIDING: 1e3, FREE: 500.0, OWN: 2.0}, {"is_distorted": True},
            [SLIDING, (FREE, "near"), (OWN, "near")],
        ),
        (
            {SLIDING: 1e3, FREE: 500.0, WIDE: 400.0, RIGID: 5e3}, {"is_distorted": True},
            [SLIDING, (FREE, "near"), (WIDE, "near"), RIGID, LATE, (FREE, "near")],
        ),
        (
            {SLIDING: 1e3, FREE: 500.0, WIDE: 400.0, RIGID: 2e3}, {"is_distorted": True},
            [SLIDING, (FREE, "near"), (WIDE, "near"), RIGID, LATE],
        ),
        ({SLIDING: 1e3, RIGID: 5.0}, {"is_distorted": True, "certain": False}, [SLIDING, RIGID]),
        ({SLIDING: 9.0}, {"coulomb": True}, [SLIDING]),
        ({SLIDING: 900.0, FREE: 50.0}, {"coulomb": True}, [SLIDING, FREE]),
        ({SLIDING: 9.0}, {"coulomb": True, "has_motions": True}, [SLIDING, ("load", "near")]),
        ({SLIDING: 2.0}, {"coulomb": True, "has_motions": True}, [SLIDING]),
        # The first model is another one, which has no fit yet.
        ({SLIDING: 9.0}, {"coulomb": True, "has_motions": True, "first": (LATE_SLIDING,)}, [SLIDING]),
    ],
)  # fmt: skip
def test_first_models_are_friction_and_a_delay_where_without_them_the_data_are_far(
    misfits: dict[Model, float],
    facts: dict[str, Any],
    fitted: list[Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From the start, or where so named from other values; misfits not given are 10,000."""
    own = [OWN] if OWN in misfits else []
    monkeypatch.setattr(model_climb, "friction_of_records", lambda *_: own)
    search, done = growing(misfits, **facts)
    fit_first(search)
    named = [
        (each[0].effects[0], each[1]) if isinstance(each, tuple) and each[0].effects else each
        for each in done
    ]
    assert named == fitted


@pytest.mark.parametrize(
    ("model", "sharp", "free", "moves", "tries", "nearer"),
    [
        (SLIDING, 50.0, 36.0, False, True, False),
        (SLIDING, 50.0, 34.0, False, True, True),
        (SLIDING, 1.12, 1.09, False, True, True),
        (SLIDING, 1.09, 0.5, False, False, False),
        (SLIDING, 50.0, 1.0, True, False, False),
        (RIGID, 50.0, 1.0, False, False, False),
    ],
)
def test_free_reversals_are_taken_where_they_come_clearly_nearer(
    model: Model, sharp: float, free: float, moves: bool, tries: bool, nearer: bool
) -> None:
    search, done = growing({model: sharp, FREE: free}, has_motions=moves)
    search.fit(model, "start")
    assert freed(search, model) == (FREE if nearer else model)
    assert done[1:] == [(FREE, "near")] * tries
    assert freed(search, model) == (FREE if nearer else model)  # fitted once
    assert len(done) == 1 + tries


@pytest.mark.parametrize(
    ("scores", "climbs"),
    [
        (gains(lag=51.0, gravity=50.0), True),  # of a cost of 100
        (gains(lag=49.0, gravity=48.0), False),
        (gains(lag=49.0, gravity=24.0), True),  # leads
        (gains(lag=9.0, gravity=1.0), False),
        (gains(lag=11.0, gravity=1.0), True),
        (gains(cubic=49.0, backlash=48.0, gravity=24.0), True),  # laws imitate each other
        (gains(gravity=49.0, cubic=24.0, backlash=25.0), False),
        (gains(lag=90.0), False),  # nothing to compare with
    ],
)
def test_parts_are_added_far_from_the_data_where_one_leads(
    monkeypatch: pytest.MonkeyPatch, scores: dict[str, Any], climbs: bool
) -> None:
    search, _ = growing({RIGID: 100.0}, scores=lambda _: scores)
    search.fit(RIGID, "start")
    climbed = list[Any]()
    monkeypatch.setattr(model_climb, "climbed", lambda *given: climbed.append(given))
    model_climb.climb_from_nearest(search, 0.5, 0.3)
    assert climbed == [(search, RIGID, 0.3)] * climbs
    assert search.is_lost


@pytest.mark.parametrize(("leads", "from_sharp"), [("arm_coulomb", True), ("gravity", False)])
def test_free_reversals_do_not_hide_friction_at_the_arm(
    monkeypatch: pytest.MonkeyPatch, leads: str, from_sharp: bool
) -> None:
    scores = gains(arm_coulomb=300.0, gravity=200.0, lag=1.0) | gains(**{leads: 400.0})
    search, _ = growing({SLIDING: 500.0, FREE: 400.0}, scores=lambda _: scores)
    search.fit(SLIDING, "start")
    search.fit(FREE, "start")
    models = list[Model]()
    monkeypatch.setattr(model_climb, "climbed", lambda _, model, ratio: models.append(model))
    model_climb.climb_from_first(search)
    assert models == [SLIDING] * from_sharp + [FREE]


def test_parts_of_nearly_the_highest_score_are_tried_and_the_first_in_place_of_a_law() -> None:
    scores = gains(lag=100.0, gravity=96.0, delay=50.0, link=99.0)
    search, _ = growing({}, scores=lambda _: scores)
    search.may_explain = lambda _, part: part != "link"
    law = RIGID.with_part("cubic")
    wider = [law.with_part("lag"), law.with_part("gravity"), RIGID.with_part("lag")]
    assert model_climb._wider(search, law) == wider


@pytest.mark.parametrize(
    ("misfit", "rows", "tried"), [(1.0, 9_000, 2), (1.0, 11_000, 1), (2.0, 11_000, 2)]
)
def test_one_part_is_tried_beside_a_model_that_explains_many_equations(
    monkeypatch: pytest.MonkeyPatch, misfit: float, rows: int, tried: int
) -> None:
    """Otherwise all clear parts: the one with the highest score may not be the best."""
    monkeypatch.setattr(model_growth, "_clear_parts", lambda *_: ["lag", "gravity"])
    monkeypatch.setattr(model_growth, "_is_promising", lambda *_: True)
    search, _ = growing({RIGID: misfit}, scores=lambda _: gains(lag=9.0, gravity=8.0))
    search.fit(RIGID, "start")
    search.fits.rows = rows
    wider = [RIGID.with_part(part) for part in ("lag", "gravity")]
    assert model_growth._extensions(search, RIGID) == wider[:tried]


@pytest.mark.parametrize(
    ("scores", "leads"),
    [(gains(lag=51.0), True), (gains(cubic=51.0, lag=49.0), False), ({}, False)],
)
def test_a_part_that_is_no_law_leads_and_none_where_none_is_missing(
    scores: dict[str, Any], leads: bool
) -> None:
    search, _ = growing({RIGID: 100.0}, scores=lambda _: scores)
    assert not model_growth.other_part_leads(search, SLIDING)  # not fitted yet
    search.fit(RIGID, "start")
    assert model_growth.other_part_leads(search, RIGID) == leads


def test_gravity_is_fitted_from_its_regression_with_friction_where_that_is_seen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(model_climb, "regression_start", lambda *_, hangs: "regressed" * hangs)
    monkeypatch.setattr(model_climb, "at_resonances", lambda *_: ["resonant"])
    monkeypatch.setattr(model_climb, "freed", lambda *_: None)
    for is_distorted, model, starts in (
        (True, SLIDING, ["regressed"]),
        (False, RIGID, ["regressed", "resonant"]),
    ):
        search, done = growing({}, is_distorted=is_distorted, phasors=None, prior=None)
        search.fits.optional = ("gravity",)
        model_climb.fit_hanging(search)
        assert done == [(model.with_part("gravity"), start) for start in starts]


@pytest.mark.parametrize(
    ("model", "ratio", "found"),
    [(FREE, 0.49, [OWN]), (FREE, 0.51, []), (SLIDING, 0.1, []), (OWN, 0.1, []), (RIGID, 0.1, [])],
)
def test_friction_may_differ_from_record_to_record_where_that_explains_half(
    monkeypatch: pytest.MonkeyPatch, model: Model, ratio: float, found: list[Model]
) -> None:
    monkeypatch.setattr(model_growth, "step_towards", lambda *_: (None, 6.0 * ratio))
    search, _ = growing({model: 6.0})
    search.fit(model, "start")
    gains = {"lag": 2.0, "damping_change": 1.0}
    search.scores = lambda _: {part: SimpleNamespace(gain=gain) for part, gain in gains.items()}
    assert model_growth.friction_of_records(search, model) == found
    gains["damping_change"] = 3.0  # whose residual it would absorb
    assert not model_growth.friction_of_records(search, model)
    far, _ = growing({model: 1e4})  # a step would leave it far from the data
    far.fit(model, "start")
    monkeypatch.setattr(model_growth, "step_towards", lambda *_: (None, 101.0))
    assert not model_growth.friction_of_records(far, model)
    moving, _ = growing({model: 6.0}, has_motions=True)
    moving.fit(model, "start")
    assert not model_growth.friction_of_records(moving, model)


@pytest.mark.parametrize(("level", "chosen"), [(2.9, FREE), (3.1, OWN)])
def test_friction_of_one_level_replaces_that_of_each_record_where_it_explains_as_much(
    monkeypatch: pytest.MonkeyPatch, level: float, chosen: Model
) -> None:
    """A fit is tried where a step from the other leaves up to three times the misfit."""
    steps = {FREE: level, SLIDING: 9.0, replace(OWN, reversal=0.0): 9.0}
    monkeypatch.setattr(model_growth, "step_towards", lambda _, other, __: (None, steps[other]))
    search, done = growing({OWN: 1.0, FREE: 1.0})
    search.fits.least = lambda models: models[-1]
    search.fit(OWN, "start")
    assert model_growth.narrowed(search, OWN) == chosen
    assert ((FREE, "near") in done) == (chosen == FREE)


@pytest.mark.parametrize(("least", "pruned"), [(RIGID, []), (LATE, [RIGID])])
def test_a_model_that_explains_the_data_is_pruned_where_only_an_insignificant_part_excludes_it(
    monkeypatch: pytest.MonkeyPatch, least: Model, pruned: list[Model]
) -> None:
    for step in ("grown", "narrowed"):
        monkeypatch.setattr(model_selection, step, lambda _, best: best)
    done = list[Model]()
    search, _ = growing({RIGID: 1.0, LATE: 5e3}, is_spent=False, is_full=lambda _: True)
    search.fit(RIGID, "start")
    search.fit(LATE, "start")
    search.fits.least, search.pruned = lambda: least, lambda model: done.append(model) or model
    assert model_selection._best(search) == least
    assert done[:1] == pruned


@pytest.mark.parametrize(
    ("effects", "of_motions", "std"),
    [
        ((), False, [0.0, 0.0]),
        (("cubic",), False, [0.0, 0.0]),
        (("hysteresis",), False, [1e-5, 2e-4]),
        (("cubic", "hysteresis", "loss_factor"), False, [1e-4, 3e-4]),
        ((), True, [0.0, 0.0]),
        (("cubic",), True, [np.hypot(0.1, 2e-4), np.hypot(0.1, 1e-3)]),
        (("cubic", "hysteresis"), True, [np.hypot(0.2, 2e-4), np.hypot(0.2, 1e-3)]),
    ],
)
def test_parts_that_are_not_computed_exactly_widen_the_error(
    effects: tuple[str, ...], of_motions: bool, std: list[float]
) -> None:
    """With hysteresis and hardly any noise, D was up to 0.024 % low: 6 standard errors."""
    K_and_D = np.array([40.0, 8.0, 0.1, 0.02])
    found: Any = SimpleNamespace(elasticity=K_and_D, elasticity_covariance=np.diag((0.1 * K_and_D) ** 2))
    model = Model(None, delay=False, effects=effects)
    added = spread_of_accuracy(model, found, of_motions=of_motions)
    np.testing.assert_allclose(np.sqrt(np.diag(added)), np.repeat(std, 2) * K_and_D, rtol=1e-12)
    found.elasticity_covariance = np.full((4, 4), np.inf)
    assert not np.isnan(spread_of_accuracy(model, found, of_motions=of_motions)).any()


@pytest.mark.parametrize(("criterion", "is_pruned"), [(70.0, True), (95.0, False)])
def test_a_nearer_model_is_pruned_of_its_insignificant_part(criterion: float, is_pruned: bool) -> None:
    """Beside filters of position and torque, K was 4.2 standard errors off without a warning."""
    best, wide, narrow = (SLIDING.with_part(part) for part in ("torque_filter", "lag", "delay"))
    judged, plain = {best: 100.0, wide: np.inf}, {best: 100.0, wide: criterion}

    def pruned(model: Model) -> Model:
        assert model == wide
        judged[narrow] = 60.0
        return narrow

    fits = SimpleNamespace(
        criterion=lambda *, judged=judged: judged or plain,
        least=lambda models: min(models, key=lambda model: judged[model]),
    )
    search: Any = SimpleNamespace(fits=fits, pruned=pruned, has_motions=False)
    assert _without_insignificant(search, best) == (narrow if is_pruned else best)
    search.has_motions = True
    assert _without_insignificant(search, best) == best


@pytest.mark.parametrize(("misfit", "far"), [(9.0, motion_noise.FAR), (1e6, 0.0)])
def test_no_misfit_is_near_once_the_first_fit_of_motions_was_far(
    monkeypatch: pytest.MonkeyPatch, misfit: float, far: float
) -> None:
    """The noise of its residual hides it."""
    found = SimpleNamespace(misfit=misfit, layout=(), elasticity="K and D")

    def fails(*_: Any) -> None:
        raise JointIdError("no weights")

    phasors: Any = SimpleNamespace(motion=np.ones(2, bool), select=lambda rows: "few")
    prior: Any = SimpleNamespace(of_rows=lambda rows: "few")
    monkeypatch.setattr(motion_noise, "_first_fit", lambda *_: (SLIDING, found))
    monkeypatch.setattr(motion_noise, "with_noise", lambda *_: phasors)
    monkeypatch.setattr(motion_noise, "noise_of_rows", fails)
    monkeypatch.setattr(motion_noise, "noise_differs", lambda *_: False)
    start: Any = SimpleNamespace(layout=())
    answer = motion_noise.with_first_noise(
        phasors, prior, np.arange(2), start, many=True, gives_up=lambda: False
    )
    assert answer == (phasors, "K and D", (SLIDING,), far)


@pytest.mark.parametrize(
    ("rows", "rank", "enough"), [(12, 9, True), (11, 5, True), (11, 6, False), (0, 0, False)]
)
def test_equations_beside_free_friction_are_twice_the_parameters(
    monkeypatch: pytest.MonkeyPatch, rows: int, rank: int, enough: bool
) -> None:
    """Of six waveforms, which may depend on each other, and three parameters."""
    residual = SimpleNamespace(projection=SimpleNamespace(rank=lambda: rank))
    monkeypatch.setattr(maximum_likelihood, "WhitenedResidual", SimpleNamespace(of=lambda *_: residual))
    problem: Any = SimpleNamespace(rows=rows, free=SimpleNamespace(shapes=6), ends=None)
    if enough:
        maximum_likelihood._require_rows(problem, np.ones(3))
    else:
        with pytest.raises(JointIdError, match="too few frequencies" if rows else "No motor moves"):
            maximum_likelihood._require_rows(problem, np.ones(3))


def test_many_equations_are_used_up_to_four_times_the_highest_resonance() -> None:
    inertia, springs = ROBOTS[2]
    prior, layout = InertiaPrior.of(inertia, 1, 2), ParameterLayout.of(2)
    few, many = (exact_lines(count) for count in (2500, 2501))  # four real numbers each
    begin = layout.named(layout.pack(K=springs.K, D=springs.D))
    highest = resonances(inertia, Elasticity(springs.K, np.zeros(2)))[-1]
    assert _highest_hz(many, prior, begin) == pytest.approx(4 * highest)
    assert _highest_hz(few, prior, begin) == np.inf
    soft = layout.named(layout.pack(K=[springs.K[0], -1.0], D=springs.D))
    assert _highest_hz(many, prior, soft) == np.inf


def exact_lines(count: int) -> Any:
    return SimpleNamespace(harmonics=np.ones((1, count, 4), complex), n=2)
