"""Transfer matrix of the motors from phasors, equations (16)-(18), independent of the controllers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.phasors.extract import Phasors
from jointid.wording import counted

_SINGULAR = 1e-8
"""Smallest singular value of the torques over the largest; below it, records are the same experiment."""
_NOISE_MARGIN = 3.0
"""Smallest singular value of the torques over their noise."""


@dataclass(frozen=True, eq=False)
class TransferMatrix:
    """Acceleration over torque, H(iω) = Y T⁻¹, at f frequencies of n joints."""

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
    n = phasors.n
    kept, rejected = [], []
    for omega, group in phasors.by_frequency():
        try:
            kept.append((omega, *_solve(phasors, omega, group)))
        except JointIdError as error:
            rejected.append(str(error))
    if not kept:
        raise JointIdError(
            f"The transfer matrix of {counted(n, 'joint')} cannot be found at any frequency. "
            f"{rejected[0]}"
        )
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
    names = ", ".join(phasors.labels[i] for i in group)
    at = f"At {omega / (2 * np.pi):.4g} Hz"
    if group.size < n:
        raise JointIdError(
            f"{at} the study has {counted(group.size, 'record')} ({names}), {n} joints need {n}: "
            "measure another in which the joints move with other relative amplitudes or phases."
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
                f"{at} the torque of joint 1 (column tau_m1_Nm) does not stand out of its noise in "
                f"{names}: excite the joint more strongly, or record longer."
            )
        raise JointIdError(
            f"{at} the torques of {names} (columns tau_m1_Nm ... tau_m{n}_Nm) are not independent: the "
            "records are the same experiment. Measure one in which the joints move with other relative "
            "amplitudes or phases, for instance one joint reversed."
        )
    inverse = np.linalg.pinv(T)
    H = Y @ inverse
    # δH = Σ_r (δY_r − H δT_r) w_r: the error of each record's equation, spread by row r of T⁻¹.
    E = np.hstack([-(omega**2) * np.eye(n), -H])
    error = np.einsum("ia,rab,jb->rij", E, phasors.covariance[group], E.conj())
    covariance = np.einsum("rik,rj,rl->ijkl", error, inverse, inverse.conj()).reshape(n * n, n * n)
    return H, covariance, float(singular[0] / singular[-1])
