"""Search for wrong units, signs, gear ratios and columns: hypotheses, each tested by a fit.

At low frequency the springs have no effect and the torques are (M + M2) q̈. A wrong scale appears there
as a factor on a joint. A hypothesis is accepted if the data that it corrects satisfy the joint equations
far better than the data as logged. Correct data are never changed.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import combinations, product

import numpy as np
from scipy.optimize import minimize

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.estimation.candidates import Model
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.joint_equations import LARGEST, LEAST, spring_equations
from jointid.estimation.estimators.linear_fit import without_inertias
from jointid.estimation.model_fits import fit_model
from jointid.estimation.model_selection import LOOSE
from jointid.joints import Inertia
from jointid.phasors.extract import Phasors
from jointid.phasors.passivity import least_misfit
from jointid.verdict.cause_findings import finding_of
from jointid.verdict.causes import CAUSES, GOOD, INACCURATE, LARGEST_GEAR_RATIO, SUBTLE, VELOCITY_UNITS
from jointid.verdict.evidence import Finding
from jointid.verdict.scorer import VELOCITY, Hypothesis, Scorer, simplest

_SNAP = 1.35  # a factor this close to a known one is taken for it
_BETTER = 0.1  # share of the misfit that corrected data may leave
_GRID, _GRID_POINTS, _FARTHEST = 0.24, 17, 0.5  # logarithms around a rough ratio
_LARGEST_FACTOR = 5e3  # degrees taken for radians twice, and a little more
_SHORTEST_S = 0.01  # shortest plausible length of the longest record with corrected times
_ABSORBED = 100.0  # misfit by absorbed power, from which the power alone proves a wrong sign
_MOST_JOINTS = 4  # above, the combinations of hypotheses are too many
_OWN_INERTIAS = "The correction includes M and M2 as fitted to the records: check the entered ones."
_FACTORS = tuple(cause.factor for cause in CAUSES)


def wrong_data(phasors: Phasors, inertias: Sequence[Inertia]) -> tuple[Finding, ...]:
    """Find wrong signs, units, gear ratios and columns.

    Parameters
    ----------
    phasors : Phasors
    inertias : sequence of Inertia
        One per record.

    Returns
    -------
    tuple of Finding
        At most one: the best hypothesis. The data as logged need not allow an estimate.
    """
    scorer, duration_s = Scorer.of(phasors, inertias), float(phasors.duration_s.max())
    bare = scorer.scores([scorer.as_logged()])
    as_logged = float(bare.cost[0])
    if as_logged < GOOD:
        return ()
    measured = low_frequency_inertia(phasors, inertias)
    bar = _BETTER * float(np.minimum(as_logged, bare.misfit[0]))
    tried = list(_hypotheses(phasors.n, measured, inertias))
    cost = scorer.scores(tried).cost
    subtle = [h.kind == "gear torque" or (h.kind == "torque" and h.scale[-1] in SUBTLE) for h in tried]
    cost[(cost > GOOD) & subtle] = np.inf  # wrong inertias cause similar factors
    if cost.min() > GOOD:
        # At low frequency the ratios are too uncertain to give a spring.
        rough = [tried[int(np.argmin(cost))]] if cost.min() < bar else []
        refined = [_refined(h, scorer) for h in (*rough, *_on_sides(_ratio(measured, inertias)))]
        possible = [h for h in refined if _is_possible(h)]
        if possible:
            found = scorer.scores(possible).cost
            found[found > _BETTER * cost.min()] = np.inf  # a free ratio always reduces the misfit
            tried, cost = [*tried, *possible], np.concatenate([cost, found])
    if cost.min() > GOOD and (found_sign := _reversed_beside_inertias(phasors, inertias, tried)):
        chosen, left = found_sign
        # Free inertias always reduce the misfit, and so does the same sign with a ratio near 1.
        alike = [bool(_is_small(h.factor / chosen.factor).all()) for h in tried]
        if left < min(bar, float(np.where(alike, cost, _BETTER * cost).min())):
            finding = finding_of(chosen, as_logged, left, str, duration_s, np.ones(scorer.n))
            return (replace(finding, detail=f"{finding.detail} {_OWN_INERTIAS}"),)
    shortest = _SHORTEST_S / duration_s
    cost[[bool(np.all(h.factor > shortest**-2.0)) for h in tried]] = np.inf  # too short
    absorbed = least_misfit(phasors.omega, phasors.z, phasors.covariance)
    if absorbed > GOOD:
        for k in np.flatnonzero(cost < bar):
            if not _supplies_power(phasors, tried[k]):
                cost[k] = np.inf
    if not cost.min() < bar:
        tried = _reversed_by_power(phasors, tried) if absorbed >= _ABSORBED else []
        if not tried:
            return ()
        cost = scorer.scores(tried).cost
    chosen = tried[simplest(cost)]
    after = scorer.scores([chosen])
    left = float(after.cost[0])
    side = partial(_side, chosen, left, scorer)
    return (finding_of(chosen, as_logged, left, side, duration_s, after.K[0]),)


def _reversed_by_power(phasors: Phasors, tried: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The reversed sign of one joint's angle or torque without which the motors would absorb power.

    With friction and wrong inertias no hypothesis explains the torques, but the power shows the sign.
    """
    return _of_one_sign([h for h in _signs(tried) if _supplies_power(phasors, h)])


def _reversed_beside_inertias(
    phasors: Phasors, inertias: Sequence[Inertia], tried: Sequence[Hypothesis]
) -> tuple[Hypothesis, float] | None:
    """The reversed sign without which the records give positive inertias, and the misfit with those.

    A regression without the given inertias fits either sign equally well, but a wrong one makes an
    inertia or a stiffness negative. It starts a fit that takes the given inertias as uncertain.
    """
    prior = InertiaPrior.of(inertias, *phasors.q.shape, inertia_std=LOOSE)
    if len(prior.M2) > 1:  # the regression is for one pose: that of most records
        rows = np.flatnonzero(prior.pose == np.bincount(prior.pose).argmax())
        own = [inertias[row] for row in rows.tolist()]
        return _reversed_beside_inertias(phasors.select(rows), own, tried)
    if without_inertias(phasors, prior) is not None:
        return None
    right, starts, fits = {}, {}, {}
    for hypothesis in _signs(tried):
        right[hypothesis] = hypothesis.corrected(phasors)
        start = without_inertias(right[hypothesis], prior)
        if start is not None:
            starts[hypothesis] = start
    for hypothesis in _of_one_sign([*starts]):
        noise = spring_equations(right[hypothesis], inertias).noise
        start, model = starts[hypothesis], Model(None, delay=False)
        with suppress(JointIdError):
            fits[hypothesis] = fit_model(right[hypothesis], prior, start, noise, model)
    # Angle and torque fit alike, with opposite couplings.
    M2 = np.array([inertia.M2 for inertia in inertias])
    off = {h: np.abs(M2 - [own.M2 for own in fit.inertias]).sum() for h, fit in fits.items()}
    best = min(off, key=off.__getitem__, default=None)
    return None if best is None else (best, fits[best].misfit)


def _signs(tried: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Each reversed sign of one signal, once."""
    signs = (h for h in tried if h.kind in ("angle", "torque") and np.all(np.abs(h.scale) == 1))
    return list({h.scale.tobytes(): h for h in signs}.values())


def _of_one_sign(found: list[Hypothesis]) -> list[Hypothesis]:
    """The hypotheses if all of them reverse the same joints, else none."""
    return found if len({tuple(np.flatnonzero(h.factor < 0)) for h in found}) == 1 else []


def _supplies_power(phasors: Phasors, hypothesis: Hypothesis) -> bool:
    """Whether the motors absorb no power in the corrected records; always true for angles of the arm."""
    order = hypothesis.order
    scale: Complexes = np.asarray(hypothesis.scale + np.zeros(phasors.z.shape, complex))
    if hypothesis.kind == VELOCITY:
        scale[:, : phasors.n] *= 1j * phasors.omega[:, None]
    covariance = phasors.covariance[:, order[:, None], order]
    covariance = covariance / (scale[:, :, None] * scale[:, None].conj())
    left = least_misfit(phasors.omega, phasors.z[:, order] / scale, covariance)
    return hypothesis.kind == "arm angle" or left < GOOD


def _hypotheses(n: int, measured: Floats | None, inertias: Sequence[Inertia]) -> Iterator[Hypothesis]:
    """Hypotheses to try, the simplest first."""
    one = np.ones(n)
    yield Hypothesis.of("torque", one, -one)
    for cause in CAUSES:  # all joints alike: the same as torque or as angle
        if cause.signal == "position":
            yield Hypothesis.of("angle", one / cause.factor, one)
        else:
            yield Hypothesis.of("torque", one, one * cause.factor)
    as_logged = Hypothesis.of("", one, one)
    for flip in 1 - 2 * np.eye(n):
        yield Hypothesis.of("angle", flip, one)
        yield Hypothesis.of("torque", one, flip)
    yield from axis_hypotheses(n)
    for a, b in combinations(range(n), 2):
        for first in (n, 0):
            order = np.arange(2 * n)
            order[[first + a, first + b]] = first + b, first + a
            yield replace(as_logged, kind="exchanged", order=order)
    for kind in ("arm angle", "gear torque"):
        yield replace(as_logged, kind=kind)
    for unit in VELOCITY_UNITS:
        yield Hypothesis.of(VELOCITY, one / unit, one)
    ratio = _ratio(measured, inertias)
    if measured is None or n > _MOST_JOINTS:
        return
    for factors in (np.array([_snapped(r) for r in ratio]), ratio):
        wrong = np.flatnonzero(factors != 1)
        for angles in product((True, False), repeat=wrong.size if wrong.size else 0):
            # Coupling shows whether the angle or the torque of a single joint is scaled.
            by_angle = np.isin(np.arange(n), wrong[list(angles)])
            kind = "angle" if by_angle.any() else "torque"
            yield Hypothesis.of(kind, np.where(by_angle, 1 / factors, 1), np.where(by_angle, 1, factors))
    M, M2 = (np.mean([getattr(i, name) for i in inertias], axis=0) for name in ("M", "M2"))
    own = np.diag(measured) - M
    square = np.diag(M2) / np.where(own > 0, own, np.inf)
    if np.all(square > 4):
        yield replace(as_logged, kind="inertia", gear=np.sqrt(square))


def axis_hypotheses(n: int) -> Iterator[Hypothesis]:
    """Whole axes that are reversed or exchanged, or both: other inertias of the same joints."""
    one = np.ones(n)
    flips = (1 - 2 * np.eye(n))[1 if n < 3 else 0 :]
    for flip in flips:
        yield Hypothesis.of("reversed axis", flip, flip)
    for a, b in combinations(range(n), 2):
        order = np.arange(2 * n)
        order[[a, b, n + a, n + b]] = b, a, n + b, n + a
        for flip in (one, *flips):
            yield replace(Hypothesis.of("exchanged", flip, flip), order=order)


def _ratio(measured: Floats | None, inertias: Sequence[Inertia]) -> Floats:
    """Torque over acceleration, measured over expected, (n,); 1 where other inertias may explain it."""
    expected = np.mean([np.diag(i.M) + i.M2 for i in inertias], axis=0)
    if measured is None:
        return np.ones(len(expected))
    ratio = np.diag(measured) / np.diag(expected)
    return np.where(_is_small(ratio), 1.0, ratio)


def _is_small(ratio: Floats) -> np.ndarray:
    return np.asarray((ratio > 1 / INACCURATE) & (ratio < INACCURATE))


def _on_sides(factor: Floats) -> list[Hypothesis]:
    """Gear that causes these factors between torque and acceleration, if any."""
    one = np.ones(factor.size)
    if np.all(factor == 1):
        return []
    found = [Hypothesis.of("torque", one, factor), Hypothesis.of("angle", 1 / factor, one)]
    if np.all(factor > 0):  # a ratio applied twice reverses no sign
        wrong = np.flatnonzero(factor != 1)[1:_MOST_JOINTS]
        for signs in product((1.0, -1.0), repeat=wrong.size):
            root = np.sqrt(factor)
            root[wrong] *= signs
            found.append(Hypothesis.of("both", 1 / root, root))
    return found


def _side(chosen: Hypothesis, after: float, scorer: Scorer) -> str:
    """Return "torque", "angle" or "both" if the coupling of the joints shows which, else ""."""
    factor = chosen.factor
    if factor.size == 1:
        return ""
    refined = [_refined(h, scorer) for h in _on_sides(np.where(np.isclose(factor, 1), 1.0, factor))]
    best: dict[str, float] = {}
    for hypothesis, cost in zip(refined, scorer.scores(refined).cost.tolist(), strict=True):
        best[hypothesis.kind] = min(cost, best.get(hypothesis.kind, np.inf))
    first, *others = sorted(best, key=lambda kind: best[kind])
    clear = best[first] <= 2 * max(after, 1.0)
    return first if clear and all(best[o] > 4 * max(best[first], 1.0) for o in others) else ""


def _refined(hypothesis: Hypothesis, scorer: Scorer) -> Hypothesis:
    """The gear ratios that explain the data best; at low frequency they are uncertain."""
    n = scorer.n
    parts = np.concatenate([hypothesis.scale, hypothesis.gear]).reshape(3, n)
    logs = np.log(np.abs(parts))
    free = np.flatnonzero(np.any(logs != 0, axis=0))
    if hypothesis.kind in ("arm angle", "gear torque", "exchanged", VELOCITY) or not free.size:
        return hypothesis
    # One ratio scales both angle and torque.
    turn = np.sign(logs) * np.sign(np.abs(logs).sum(axis=0))

    def scaled(x: Floats) -> Hypothesis:
        more = np.zeros(n)
        more[free] = x
        new = parts * np.exp(turn * more)
        return replace(hypothesis, scale=new[:2].ravel(), gear=new[2])

    def cost(x: Floats) -> float:
        if np.any(np.abs(x) > _FARTHEST):
            return 1e3
        least, most = 1e-300, 1e300
        return float(np.log(np.clip(scorer.scores([scaled(x)]).cost[0], least, most)))

    # Other local minima, with negative springs, are near that of the right ratios.
    axis = np.linspace(-_GRID, _GRID, _GRID_POINTS) if free.size < 3 else np.zeros(1)
    grid = np.array(sorted(product(axis, repeat=free.size), key=lambda x: float(np.square(x).sum())))
    start = grid[int(np.argmin(scorer.scores([scaled(x) for x in grid]).cost))]
    found = minimize(
        cost,
        start,
        method="Nelder-Mead",
        options={
            "initial_simplex": np.vstack([start, start + 0.02 * np.eye(start.size)]),
            "maxfev": 60 * start.size,
            "xatol": 1e-4,
            "fatol": 0.01,
        },
    )
    return scaled(np.asarray(found.x, float))


def _is_possible(hypothesis: Hypothesis) -> bool:
    """Whether every factor can be that of a gear, or of a unit together with a gear."""
    factor = np.abs(hypothesis.factor)
    common = (np.abs(np.log(factor / c.factor)) < np.log(30) for c in CAUSES if c.is_common)
    return bool(
        hypothesis.gear.max() <= LARGEST_GEAR_RATIO
        and (
            np.all(np.abs(np.log(np.abs(hypothesis.scale))) <= np.log(LARGEST_GEAR_RATIO))
            or any(np.all(near) for near in common)
            or np.all(np.abs(np.log(factor)) < np.log(_LARGEST_FACTOR))
        )
    )


def _snapped(ratio: float) -> float:
    known = (f for f in (-1.0, *_FACTORS, -_FACTORS[0]) if ratio * f > 0 and f not in SUBTLE)
    return next((f for f in known if 1 / _SNAP < ratio / f < _SNAP), float(ratio))


def low_frequency_inertia(phasors: Phasors, inertias: Sequence[Inertia]) -> Floats | None:
    """Return the matrix (n, n) that maps acceleration to torque at ω → 0, as measured; None if too few.

    The springs' share grows with ω²; it is removed by extrapolation over the lowest frequencies. The
    torque of gravity is subtracted.
    """
    gravity = np.einsum("rij,rj->ri", np.array([i.gravity for i in inertias]), phasors.q)
    tau = phasors.tau - gravity
    n = phasors.n
    groups = phasors.by_frequency()
    acceleration = -(phasors.omega[:, None] ** 2) * phasors.q
    for frequencies, order in ((3, 1), (2, 1), (1, 0)):
        rows = np.concatenate([group for _, group in groups[:frequencies]])
        if len(groups) < frequencies or rows.size < n * (order + 1):
            continue
        x = (phasors.omega[rows] / phasors.omega[rows].max()) ** 2
        terms = [acceleration[rows] * (x**k)[:, None] for k in range(order + 1)]
        A = np.concatenate(terms, axis=1)
        size = np.linalg.norm(A, axis=0)
        if not np.all(size > 0):
            continue
        real = np.concatenate([(A / size).real, (A / size).imag])
        if np.linalg.cond(real) < 1e4:
            b = np.concatenate([tau[rows].real, tau[rows].imag])
            inertia = (np.linalg.lstsq(real, b, rcond=None)[0] / size[:, None])[:n].T
            size = np.abs(np.diag(inertia))
            return np.asarray(inertia) if np.all((size > LEAST) & (size < LARGEST)) else None
    return None
