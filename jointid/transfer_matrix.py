"""Transfer matrix of the motors from phasors, equations (16)-(18), independent of the controllers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.motion.sampling import parts_of_records
from jointid.motion.spectral_lines import RecordSpectrum, SpectralLines
from jointid.phasors.coherence import coherent_band
from jointid.phasors.extract import Phasors
from jointid.records import MotionRecord
from jointid.wording import counted, percent

_SINGULAR = 1e-8
"""Smallest singular value of the torques over the largest; below it, records are the same experiment."""
_ORDERS = (7, 5, 3)
"""Orders of the local polynomials of H and of the end terms; the highest that the lines allow is used.
At a sharp resonance, order 3 is several standard errors off."""
_LINES, _NARROW = 8, 0.6
"""Half width of a local band: spectral lines of the longest record, and at least Hz."""
_BIASED = 0.2
"""Share of H by which noise of the torques may reduce it."""
_SURE = 2.0
"""Standard errors of a measured power that are kept as a margin."""
_UNKNOWN = 0.5
"""Relative error of H from a motion without information."""
_NOISE_MARGIN = 3.0
"""Smallest singular value of the torques over their noise."""


@dataclass(frozen=True, eq=False)
class TransferMatrix:
    """Acceleration over torque, H(iω) = Y T⁻¹, equations (16)-(18), at f frequencies of n joints."""

    omega: Floats
    """Frequencies, ascending, shape (f,), rad/s."""
    H: Complexes
    """Transfer matrix, shape (f, n, n), 1/(kg·m²)."""
    covariance: Complexes
    """Covariance E[δh δhᴴ] of the elements h = (H11, H12, ..., Hnn), shape (f, n², n²)."""
    condition: Floats
    """Condition number of the torque matrix T with rows of unit length, shape (f,)."""
    reciprocity_error: Floats
    """Largest |H_ij − H_ji| over √|H_ii H_jj|, shape (f,), from noise or wrong units and signs."""
    rejected: tuple[str, ...]
    """Frequencies that were not inverted, each with the reason and the remedy."""

    @property
    def standard_deviation(self) -> Floats:
        """Root of the variance of each complex element of H, shape (f, n, n)."""
        variance = np.abs(np.einsum("fhh->fh", self.covariance))
        return np.asarray(np.sqrt(variance).reshape(self.H.shape))


def estimate_transfer_matrix(phasors: Phasors) -> TransferMatrix:
    """Solve equation (17) at every frequency; with more than n records by least squares.

    Parameters
    ----------
    phasors : Phasors
        At least n records per frequency, of one pose.

    Returns
    -------
    TransferMatrix
        Without the frequencies of linearly dependent torques, which ``rejected`` lists.

    Raises
    ------
    JointIdError
        When no frequency can be inverted.
    """
    groups = {omega: partial(_solve, phasors, omega, group) for omega, group in phasors.by_frequency()}
    problem = (
        f"The transfer matrix of {counted(phasors.n, 'joint')} cannot be estimated at any frequency."
    )
    return _matrix(groups, problem)


def record_spectra(records: Sequence[MotionRecord]) -> list[RecordSpectrum]:
    """Spectra of all records of one pose, for :func:`motion_transfer_matrix`.

    Raises JointIdError when a clock is too uneven or a record has no coherent band.
    """
    if len({record.n for record in records}) != 1:
        raise JointIdError("The transfer matrix needs motion records, all of the same joints.")
    found = []
    for record, parts in zip(records, parts_of_records(records), strict=True):
        band_hz = record.band_hz or coherent_band(record)
        found += [RecordSpectrum.of(part, record, band_hz) for part in parts]
    return found


def motion_transfer_matrix(
    spectra: Sequence[RecordSpectrum],
    *,
    coulomb: Floats | float = 0.0,
    viscous: Floats | float = 0.0,
    delay: float = 0.0,
) -> TransferMatrix:
    """Estimate H from any motion of one pose by local polynomials, without a model of the robot.

    Within a narrow band H is a polynomial of the frequency, and so is the contribution of the states at
    both ends of each record (Pintelon and Schoukens, System Identification, 2nd ed. 2012, section 7.2).
    The scatter about both gives the covariance. ``coulomb`` and ``viscous``, shape (n,), are friction to
    subtract from the torque, N·m and N·m·s/rad; ``delay`` is that of the torque in addition to that of
    the records, s. Raises JointIdError when no frequency can be solved for.
    """
    parts = [each.part for each in spectra]
    half = max(_LINES / max(part.duration_s for part in parts), _NARROW)
    low, high = min(each.band_hz[0] for each in spectra), max(each.band_hz[1] for each in spectra)
    centres = np.arange(low + half, high - half, 2 * half).tolist()
    free = [each.without(coulomb, viscous, delay) for each in spectra]
    bands = {2 * np.pi * centre: partial(_local, free, centre, half) for centre in centres}
    matrix = _matrix(bands, "The transfer matrix cannot be estimated from these motions.")
    held_s = max((part.interval_s for part in parts if part.held), default=0.0)
    return replace(matrix, covariance=matrix.covariance + _of_images(matrix, held_s))


def _of_images(matrix: TransferMatrix, held_s: float) -> Floats:
    """Covariance of H, as ``TransferMatrix.covariance``, by images of torques held for that long.

    They move the rotor, and are folded into its sampled angles, where −(ωT/2)⁴/15/M of H remains.
    """
    n = matrix.H.shape[1]
    diagonal = np.abs(np.einsum("fii->fi", matrix.H))
    rotors = np.maximum(diagonal[-1], np.median(diagonal, axis=0))  # about 1 / M
    images = (0.5 * matrix.omega[:, None] * held_s) ** 4 / 15 * rotors
    diagonals = np.eye(n * n)[:: n + 1]  # H11, H22, ...
    return np.asarray(np.einsum("fj,ja,jb->fab", images**2, diagonals, diagonals))


def _local(
    spectra: Sequence[RecordSpectrum], centre: float, half: float
) -> tuple[Complexes, Complexes, float]:
    """H, its covariance and the condition of the torques from the lines around a frequency."""
    for order in _ORDERS:
        try:
            return _polynomial(spectra, centre, half, order)
        except JointIdError as error:
            reason = error
    raise reason


def _polynomial(
    spectra: Sequence[RecordSpectrum],
    centre: float,
    half: float,
    order: int,
) -> tuple[Complexes, Complexes, float]:
    """H, its covariance and the condition by polynomials of one order."""
    lines = []
    for each in spectra:
        near = np.abs(each.frequency_hz - centre) <= half
        if near.sum() > order:
            values = each.acceleration[near], each.torque[near], each.noise[:, near]
            lines.append(SpectralLines.of((each.frequency_hz[near] - centre) / half, order, *values))
    at = f"At {centre:.4g} Hz"
    too_few = f"{at} the records have too few spectral lines: record longer."
    if not lines:
        raise JointIdError(too_few)
    A = np.concatenate([each.regressors(each.torque) for each in lines])
    y = np.concatenate([each.left @ each.acceleration for each in lines])
    n = y.shape[1]
    freedom = len(A) - A.shape[1]
    if freedom < n + 1:
        raise JointIdError(too_few)
    size = np.linalg.norm(A, axis=0)
    if not np.all(size > 0):
        raise JointIdError(f"{at} the torque of a joint is zero in every record: excite it.")
    U, singular, Vh = np.linalg.svd(A / size, full_matrices=False)
    if singular[-1] < _SINGULAR * singular[0]:
        raise JointIdError(f"{at} the torques of the joints are not independent: vary their ratios.")
    inverse = (Vh.conj().T / singular) @ U.conj().T / size[:, None]
    found = inverse @ y
    rest = y - A @ found
    left = rest.T @ rest.conj() / freedom
    angles, answers = np.sum([each.expected_noise for each in lines], axis=0)
    # Rounding of a slow motion is smooth over the lines, and leaves less scatter than its power.
    left += np.diag(np.maximum(angles / len(A) - np.diag(left).real, 0.0))
    constant = np.arange(n) * (order + 1)
    squares = inverse @ inverse.conj().T
    spread = squares[np.ix_(constant, constant)]
    covariance = np.einsum("ik,jl->ijkl", left, spread).reshape(n * n, n * n)
    H = found[constant].T
    if np.all(np.diag(left).real * np.diag(spread).real > np.abs(_UNKNOWN * np.diag(H)) ** 2):
        raise JointIdError(f"{at} the motion does not exceed the noise: move the joints more.")
    answer = np.sqrt(angles * answers)[:, None] * np.abs(spread.T)
    if np.any(np.diag(answer) > _UNKNOWN * np.abs(np.diag(H))):
        raise JointIdError(
            f"{at} the controllers respond to the noise of the angles, which may change H by "
            f"more than {percent(_UNKNOWN)}: move the joints more at this frequency."
        )
    if np.linalg.matrix_rank(H) < n:
        raise JointIdError(f"{at} a joint does not move: excite it.")
    power = _noise_power(lines, freedom, H, angles / len(A))
    bias = (squares @ power @ found)[constant].T
    if np.any(np.abs(np.diag(bias)) > _BIASED * np.abs(np.diag(H))):
        raise JointIdError(
            f"{at} noise may reduce H by more than {percent(_BIASED)}: move the joints "
            "more at this frequency, or record longer."
        )
    for error in (bias, answer):
        covariance += np.outer(error, error.conj())
    T = np.concatenate([each.torque for each in lines])
    condition = np.linalg.cond(T / np.linalg.norm(T, axis=0)) if n > 1 else 1.0
    return H, covariance, float(condition)


def _noise_power(
    lines: Sequence[SpectralLines], freedom: int, H: Complexes, angles: Floats
) -> Complexes:
    """Part of the regressors' normal matrix by noise of the torques, by which least squares reduce H.

    The noise is what the accelerations leave of the torques, less the part that the noise of the
    accelerations, of variance ``angles``, shape (n,), makes there. Their scatter is kept as a margin.
    """
    B = np.concatenate([each.regressors(each.acceleration) for each in lines])
    torques = np.concatenate([each.left @ each.torque for each in lines])
    scatter = torques - B @ np.linalg.lstsq(B, torques, rcond=None)[0]
    covariance = scatter.T.conj() @ scatter / freedom
    of_angles = np.linalg.inv(H)
    values, vectors = np.linalg.eigh(covariance - (of_angles.conj() * angles) @ of_angles.T)
    kept = min(_SURE / np.sqrt(freedom), 1.0)
    own = (vectors * np.maximum(values, 0.0)) @ vectors.conj().T
    covariance = kept * covariance + (1 - kept) * own
    return np.asarray(np.kron(covariance, sum(each.noise_power for each in lines)))


def _matrix(
    solvers: Mapping[float, Callable[[], tuple[Complexes, Complexes, float]]], problem: str
) -> TransferMatrix:
    """Solve for H at every frequency; ``problem`` is the message when none can be solved."""
    kept, rejected = [], []
    for omega, solve in solvers.items():
        try:
            kept.append((omega, *solve()))
        except JointIdError as error:
            rejected.append(str(error))
    if not kept:
        raise JointIdError(" ".join([problem, *rejected[:1]]))
    omegas, matrices, covariances, conditions = zip(*kept, strict=True)
    H = np.array(matrices)
    size = np.sqrt(np.abs(np.einsum("fii->fi", H)))
    unlike, scale = np.abs(H - H.swapaxes(1, 2)), size[:, :, None] * size[:, None]
    asymmetry = np.divide(unlike, scale, out=np.where(unlike > 0, np.inf, 0.0), where=scale > 0)
    return TransferMatrix(
        omega=np.array(omegas),
        H=H,
        covariance=np.array(covariances),
        condition=np.array(conditions),
        reciprocity_error=np.asarray(asymmetry.max(axis=(1, 2))),
        rejected=tuple(rejected),
    )


def single_record_response(phasors: Phasors) -> Complexes:
    """Acceleration over torque of each joint from one record alone, the dotted curve of Figure 3.

    For two joints this is H11 + H12 τ2/τ1, which depends on the other joint's controller through τ2.

    Parameters
    ----------
    phasors : Phasors
        r records of n joints.

    Returns
    -------
    ndarray, shape (r, n), complex
        1/(kg·m²); NaN where a joint has no torque.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        response = -(phasors.omega[:, None] ** 2) * phasors.q / phasors.tau
    return np.where(phasors.tau == 0, np.nan, response)


def _solve(phasors: Phasors, omega: float, group: np.ndarray) -> tuple[Complexes, Complexes, float]:
    n = phasors.n
    names = ", ".join(f'"{phasors.labels[i]}"' for i in group)
    at = f"At {omega / (2 * np.pi):.4g} Hz"
    if group.size < n:
        raise JointIdError(
            f"{at} the study has {counted(group.size, 'record')} ({names}); {n} joints need {n}: "
            "measure another record with different relative amplitudes or phases of the joints."
        )
    T, Y = phasors.tau[group].T, -(omega**2) * phasors.q[group].T  # records as columns
    scale = np.linalg.norm(T, axis=1)
    if not np.all(scale > 0):
        j = int(np.argmin(scale)) + 1
        raise JointIdError(
            f"{at} the torque of joint {j} (column tau_m{j}_Nm) is zero in every record ({names}): "
            "excite that joint in at least one of them."
        )
    singular = np.linalg.svd(T / scale[:, None], compute_uv=False)
    noise = np.sqrt(np.abs(np.einsum("rjj->rj", phasors.covariance[group])[:, n:]).max(axis=0)) / scale
    if singular[-1] <= max(_SINGULAR * singular[0], _NOISE_MARGIN * noise.max()):
        if n == 1:
            raise JointIdError(
                f"{at} the torque of joint 1 (column tau_m1_Nm) does not exceed its noise in "
                f"{names}: excite the joint more strongly, or record longer."
            )
        raise JointIdError(
            f"{at} the torques of {names} (columns tau_m1_Nm ... tau_m{n}_Nm) are not independent, "
            "as in repeated experiments. Measure a record with different relative amplitudes or phases "
            "of the joints, for instance with one joint reversed."
        )
    inverse = np.linalg.pinv(T)
    H = Y @ inverse
    # δH = Σ_r (δY_r − H δT_r) w_r: the error of each record's equation, spread by row r of T⁻¹.
    E = np.hstack([-(omega**2) * np.eye(n), -H])
    error = np.einsum("ia,rab,jb->rij", E, phasors.covariance[group], E.conj())
    covariance = np.einsum("rik,rj,rl->ijkl", error, inverse, inverse.conj()).reshape(n * n, n * n)
    return H, covariance, float(singular[0] / singular[-1])
