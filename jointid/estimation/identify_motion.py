"""Identification from records of any motion, alone or together with sines, in one likelihood."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.candidates import Choice, Model
from jointid.estimation.elasticity import ElasticityFit, likelihood_fit
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.joint_equations import spring_equations
from jointid.estimation.estimators.linear_fit import LINEAR
from jointid.estimation.estimators.maximum_likelihood import LikelihoodEstimate
from jointid.estimation.estimators.noise import Noise
from jointid.estimation.estimators.parameters import Parameters
from jointid.estimation.identify_elasticity import require_gear, require_method
from jointid.estimation.model_fits import evaluated, fit_model
from jointid.estimation.model_selection import choose_model
from jointid.estimation.motion_noise import (
    SAME,
    SAME_OF_MANY,
    contradicts_inertias,
    noise_differs,
    noise_of_rows,
    times_logged_noise,
    with_first_noise,
    with_noise,
    with_torque_noise,
)
from jointid.estimation.regression_start import regressed, regression_start
from jointid.joints import Elasticity, Inertia, resonances
from jointid.motion.friction import friction_waveforms
from jointid.motion.sampling import UniformPart, parts_of_records
from jointid.motion.spectra import motion_phasors
from jointid.phasors.extract import Phasors, extract_phasors, slow_changes
from jointid.records import MotionRecord, SineRecord, require_equal_joints, require_torques
from jointid.small_matrices import one_thread

_EQUAL = 10.0
"""Information criterion over the least up to which a model is compared again with other noise."""
_REJECTED = 100.0
"""Cost over that of the chosen model beyond which a law of the gears is not compared again."""
_MOVES = 4.0
"""Power of the angle over its noise, mean over the band, of a joint that moves."""
_TOGETHER = 0.1
"""Least over most power of the joints that move together, each over its largest of all segments."""
_FEW = 6
"""Segments of motions for the first estimates of noise and model, from which the whole fit starts."""
_MANY = 10_000
"""Number of equations above which the model of many joints also comes from the first segments."""
_BEYOND = 4.0
"""Frequency over the highest resonance up to which many equations are used."""
_CROWDED, _WIDER = 1.5, 2.0
"""Unknown torques in short rests over equations of a joint from which the band is wider, and its factor:
a wider band resolves the short moves between them."""
_SEARCHES, _TWICE = 3, 1.0
"""Most further searches with the noise that the chosen model leaves, and the change of its variance,
over the smaller one, that asks for more than one: with twice the noise, a wrong minimum may pass."""


def require_motion_method(method: str) -> None:
    """Raise JointIdError when an estimator is unknown, or takes sine records only."""
    require_method(method)
    if method in LINEAR:
        raise JointIdError(
            f'The estimator "{method}" takes sine records only, and this study has records of other '
            'motions: choose "auto".'
        )


def identify_motion(
    records: Sequence[MotionRecord | SineRecord],
    inertia: Inertia | Sequence[Inertia],
    *,
    inertia_std: float | None = None,
    torque_std: float | None = None,
    gear: str = "auto",
    friction: bool = False,
    delay: bool = False,
    gives_up: Callable[[], bool] = bool,
) -> ElasticityFit:
    """Identify K and D of every joint from records of any motion around one pose each.

    Parameters
    ----------
    records : sequence of MotionRecord or SineRecord
        Of the same joints. Friction, delay and effects are chosen by the data.
    inertia : Inertia or sequence of Inertia
        Motor side; one per record for records of several poses.
    inertia_std, torque_std, gear
        As in :func:`identify_elasticity`.
    friction, delay : bool, default False
        Fit them in every model compared.
    gives_up : callable, optional
        Called if the first models are far from the data; the result True (wrong data) ends the search.

    Returns
    -------
    ElasticityFit
        Its ``phasors``, ``equations`` and ``residual`` have a row for each sine and for each spectral
        line of each segment of a motion.

    Raises
    ------
    JointIdError
        When a record's clock is too uneven or its band is empty, a joint is not excited, or the records
        do not separate the parameters.
    """
    require_gear(gear)
    records = _checked(records)
    require_torques(records)
    n = records[0].n
    given = InertiaPrior.of(inertia, len(records), n, inertia_std=inertia_std, torque_std=torque_std)
    search = partial(choose_model, friction=friction, delay=delay, gear=gear, gives_up=gives_up)
    with one_thread():
        return _identified(records, given, search, gives_up)


def motion_misfits(records: list[MotionRecord | SineRecord], priors: list[InertiaPrior]) -> Floats:
    """Misfit of motions under inertias of several priors, by a regression with friction; at least 1."""
    some, rows = few_phasors(records, priors[0])
    return np.array([regressed(some, prior.of_rows(rows))[1] for prior in priors])


def few_phasors(
    records: list[MotionRecord | SineRecord], prior: InertiaPrior
) -> tuple[Phasors, np.ndarray]:
    """Phasors of some segments of motions and of all sines, and the record of each row."""
    phasors, source = _phasors(records, prior.M[prior.rotor])
    few = _few(phasors, prior.of_rows(source))
    return phasors.select(few), source[few]


def _checked(records: object) -> list[MotionRecord | SineRecord]:
    each = [records] if isinstance(records, MotionRecord | SineRecord) else records
    if not isinstance(each, Sequence) or not each:
        raise JointIdError(f"records: expected a list of MotionRecord, got {records!r:.80}.")
    for record in each:
        if not isinstance(record, MotionRecord | SineRecord):
            raise JointIdError(f"records: expected MotionRecord values, got {record!r:.80}.")
    require_equal_joints(each)
    for i, j in itertools.combinations(range(each[0].n), 2):
        angles = [record.theta_rad[:, [i, j]].T for record in each]
        if all(np.array_equal(*pair) for pair in angles) and any(np.ptp(pair[0]) > 0 for pair in angles):
            raise JointIdError(
                f"theta_m{i + 1}_rad and theta_m{j + 1}_rad hold the same samples in every record: the "
                "two joints cannot be separated. Check which column belongs to which joint, or add a "
                f"record in which joint {j + 1} moves differently."
            )
    return list(each)


def _identified(
    records: list[MotionRecord | SineRecord],
    given: InertiaPrior,
    search: Callable[..., Choice],
    gives_up: Callable[[], bool],
) -> ElasticityFit:
    sampled = parts_of_records([each for each in records if isinstance(each, MotionRecord)])
    phasors, source = _phasors(records, given.M[given.rotor], sampled=sampled)
    _require_motion(phasors)
    prior = given.of_rows(source)
    begin = regression_start(phasors, prior)
    widened = _WIDER if "coulomb" in begin.layout and _is_crowded(phasors) else 1.0
    most_hz = _highest_hz(phasors, prior, begin)
    if widened > 1 or most_hz < phasors.excited.max() / (2 * np.pi):
        phasors, source = _phasors(records, given.M[given.rotor], widened, most_hz, sampled)
        prior = given.of_rows(source)
    whole = phasors, prior
    rows, many = _few(phasors, prior), _are_many(phasors)
    if many:
        phasors, prior, rows = phasors.select(rows), prior.of_rows(rows), np.arange(rows.size)
    start: Floats | Parameters
    phasors, start, first, far = with_first_noise(
        phasors, prior, rows, begin, many=many, gives_up=gives_up
    )
    few, own = phasors.select(rows), prior.of_rows(rows)
    known = [each for each in first if many or each.delay or each.differs]
    search = partial(search, far=far)
    choice = search(few, own, start, noise=noise_of_rows(few, own), first=known)
    same = SAME_OF_MANY if many and (choice.model,) == first else SAME
    left = rows.size < phasors.omega.size
    for _ in range(_SEARCHES):
        again = with_noise(phasors, prior, choice.model, choice.estimate)
        found = choice.estimate
        is_wrong = isinstance(found, LikelihoodEstimate) and found.misfit >= far and gives_up()
        if not left and (is_wrong or not noise_differs(again, phasors, same)):
            break
        same, left = _TWICE, False
        phasors = again
        if isinstance(found, LikelihoodEstimate):
            search = partial(search, first=_equals(choice), rejected=_rejected(choice))
            search = partial(search, earlier_misfit=found.misfit)
            start = found.named
        choice = search(phasors, prior, start, noise=noise_of_rows(phasors, prior))
    if not isinstance(choice.estimate, LikelihoodEstimate):
        raise choice.estimate
    estimate, noise = choice.estimate, noise_of_rows(phasors, prior)
    searched = phasors, prior, estimate, noise, choice.model
    if len(phasors.omega) < len(whole[0].omega):
        torques = {each.record: each.torque_variance for each in again.segments if each is not None}
        prior = whole[1]
        phasors = with_torque_noise(*whole, torques, prior.motors(whole[0], estimate.named))
        phasors = with_noise(phasors, prior, choice.model, estimate)  # of every record
        noise = noise_of_rows(phasors, prior)
        estimate = fit_model(phasors, prior, estimate.named, noise, choice.model, is_near=True)
    fitted = evaluated(phasors, prior, choice.model, estimate, noise, estimate.scale)
    lines, inertias = _lines(estimate, phasors, noise)
    noise = Noise(lines.harmonic_covariance, lines.degrees_of_freedom)
    equations = spring_equations(lines, inertias, noise=noise)
    fit = likelihood_fit("auto", choice, estimate, equations, prior, fitted.torsion_curves())
    return replace(
        fit,
        phasors=lines,
        prior=given,
        inertias=tuple(estimate.inertias[row] for row in np.unique(source, return_index=True)[1]),
        contradicts_inertias=contradicts_inertias(*searched, fit.standard_error),
        times_logged_noise=times_logged_noise(phasors) if phasors.motion.any() else 0.0,
    )


def _equals(choice: Choice) -> tuple[Model, ...]:
    """The chosen model, and quick ones that other noise may prefer to it."""
    least = min(each.criterion for each in choice.candidates)
    near = [each for each in choice.candidates if each.criterion < least + _EQUAL and not each.chosen]
    return (choice.model, *(each.model for each in near if not each.model.is_slow))


def _rejected(choice: Choice) -> tuple[Model, ...]:
    """Models with a law of the gears that explain the records far worse than the chosen model does."""
    most = _REJECTED + min(each.cost for each in choice.candidates if each.chosen)
    slow = (each for each in choice.candidates if each.model.is_slow)
    return tuple(each.model for each in slow if most < each.cost < each.expected_cost)


def _are_many(phasors: Phasors) -> bool:
    """Whether some segments of many joints suffice to find the model, and all would be slow."""
    return phasors.n > 2 and bool(2 * np.count_nonzero(phasors.harmonics[..., : phasors.n]) > _MANY)


def _few(phasors: Phasors, prior: InertiaPrior) -> np.ndarray:
    """Rows of evenly spread segments of motions, of every joint's motion in every pose, and sines."""
    moves = np.flatnonzero(phasors.motion)
    if moves.size <= _FEW:
        return np.arange(phasors.omega.size)
    power = np.sum(np.abs(phasors.harmonics[moves, :, : phasors.n]) ** 2, axis=1)
    share = power / np.maximum(power.max(axis=0), np.finfo(float).tiny)
    in_turn = np.median(share.min(axis=1) / share.max(axis=1)) < _TOGETHER
    kind = np.argmax(share, axis=1) * in_turn + phasors.n * prior.pose[moves]
    each = max(2, _FEW // np.unique(kind).size)
    of_kinds = (moves[kind == k] for k in np.unique(kind))
    chosen = [rows[:: -(-rows.size // each)] for rows in of_kinds]
    return np.sort(np.concatenate([np.flatnonzero(~phasors.motion), *chosen]))


def _lines(
    estimate: LikelihoodEstimate, phasors: Phasors, noise: Noise
) -> tuple[Phasors, list[Inertia]]:
    """Compensated phasors with a row for each sine and each bin, and their inertias."""
    clean, n = estimate.phasors, phasors.n
    known = np.any(phasors.harmonics != 0, axis=2) & phasors.motion[:, None]
    known[:, 0] |= ~phasors.motion
    row, bins = np.nonzero(known)
    z = np.where(phasors.motion[row, None], clean.harmonics[row, bins], clean.z[row])
    covariance = noise.covariance[row, bins]
    short = {  # a copy in each row would be large
        name: getattr(clean, name)[:, :1]
        for name in ("harmonics", "harmonic_covariance", "harmonic_rounding")
    }
    lines = replace(
        replace(clean, **short).select(row),
        omega=phasors.omega[row] * (bins + 1),
        q=z[:, :n],
        tau=z[:, n:],
        covariance=covariance,
        harmonics=z[:, None],
        harmonic_covariance=covariance[:, None],
        frequency_found_hz=phasors.omega[row] * (bins + 1) / (2 * np.pi),
        segments=(),
    )
    return lines, [estimate.inertias[k] for k in row]


def _is_crowded(phasors: Phasors) -> bool:
    """Whether short rests in the motions have far more unknown torques than some joint has equations."""
    unknown = friction_waveforms(phasors, 0.0).unknown
    motions = [unknown[row] for row in np.flatnonzero(phasors.motion).tolist()]
    torques: Floats = np.sum([each.in_short_rests for each in motions], axis=0)
    equations: Floats = np.sum([each.equations for each in motions], axis=0)
    return bool(np.any(torques > _CROWDED * equations))


def _highest_hz(phasors: Phasors, prior: InertiaPrior, begin: Parameters) -> float:
    """Frequency above which many equations hardly depend on K and D; infinite for few."""
    if 2 * np.count_nonzero(phasors.harmonics[..., : phasors.n]) <= _MANY or np.any(begin.K <= 0):
        return np.inf
    springs = Elasticity(begin.K, np.zeros(phasors.n))
    every = prior.inertias(prior.M, prior.M2)
    return _BEYOND * max(float(resonances(each, springs)[-1]) for each in every)


def _phasors(
    records: list[MotionRecord | SineRecord],
    M: Floats,
    widened: float = 1.0,
    most_hz: float = np.inf,
    sampled: Sequence[list[UniformPart]] | None = None,
) -> tuple[Phasors, np.ndarray]:
    """Rows of all records, and the record of each row.

    Parts of the motions on a uniform grid may be known.
    """
    motions = {k: record for k, record in enumerate(records) if isinstance(record, MotionRecord)}
    sines = {k: record for k, record in enumerate(records) if isinstance(record, SineRecord)}
    parts: list[Phasors] = []
    source: list[int] = []
    if sines:
        parts.append(extract_phasors(list(sines.values())))
        source += sines
    if motions:
        moved, rotors = list(motions.values()), M[list(motions)]
        rows = motion_phasors(moved, rotors, widened, most_hz, sampled)
        parts.append(rows)
        numbers = list(motions)
        source += [numbers[segment.record] for segment in rows.segments if segment is not None]
    joined = Phasors.joined(parts)
    order = np.argsort(source, kind="stable")
    in_order = replace(joined.select(order), progress=slow_changes(order.size))
    return in_order, np.asarray(source)[order]


def _require_motion(phasors: Phasors) -> None:
    """Refuse a joint that does not move above its noise in any record."""
    n, known = phasors.n, np.any(phasors.harmonics != 0, axis=2)
    variance = np.einsum("rhjj->rhj", phasors.harmonic_covariance).real[..., :n]
    power = np.abs(phasors.harmonics[..., :n]) ** 2
    clear = np.divide(power, variance, out=np.zeros_like(power), where=variance > 0)
    clear = clear.sum(axis=1) / np.maximum(known.sum(axis=1), 1)[:, None]
    held = friction_waveforms(phasors, None).stationary.all(axis=0)
    for j in np.flatnonzero(held | (clear.max(axis=0) < _MOVES)).tolist():
        raise JointIdError(
            f"Joint {j + 1} is not excited: theta_m{j + 1}_rad does not move above its noise within the "
            f"band of any record, so K{j + 1} and D{j + 1} cannot be identified. Move joint {j + 1}, "
            "or widen band_hz."
        )
