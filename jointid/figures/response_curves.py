"""Frequency responses ready to draw: what was measured, the models over it, and the scales they share.

Nothing here draws: the app's figures and the report's drawings take the same curves from here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointid.answer import without
from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.joints import Elasticity, motor_response, resonances
from jointid.study import Analysis
from jointid.transfer_matrix import TransferMatrix, single_record_response

_POINTS = 400
_PEAK_POINTS = 41


@dataclass(frozen=True, eq=False)
class Response:
    """One frequency response."""

    frequency_hz: Floats
    """Shape (f,), Hz."""
    H: Complexes
    """Acceleration over torque, shape (f,), 1/(kg·m²)."""
    error: Floats | None = None
    """Standard error along H, and across it, shape (f,), 1/(kg·m²); None when it is not known."""

    @property
    def relative_error(self) -> Floats | None:
        """Standard error over magnitude, which is that of the phase in rad, shape (f,)."""
        if self.error is None:
            return None
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.error / np.abs(self.H))


def element_name(i: int, j: int) -> str:
    """Return "H₁₂" for joints 0 and 1."""
    return f"H{i + 1}{j + 1}".translate(str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉"))


def measured(matrix: TransferMatrix, i: int, j: int) -> Response:
    """Return the points of H_ij by equations (17)-(18)."""
    error = matrix.standard_deviation[:, i, j] / np.sqrt(2)  # half of a complex variance lies along H
    return Response(matrix.omega / (2 * np.pi), matrix.H[:, i, j], error)


def freed_or_measured(analysis: Analysis, pose: str) -> tuple[TransferMatrix, str]:
    """Return the transfer matrix to hold against the model, and what is not in it, in words."""
    removed = without(analysis.fit)
    if not removed or pose not in analysis.freed_transfer_matrices:
        return analysis.transfer_matrices[pose], ""
    return analysis.freed_transfer_matrices[pose], removed


def single_records(analysis: Analysis, pose: str, joint: int) -> list[Response]:
    """Return acceleration over torque of a joint from each record alone, one response per series."""
    rows = analysis.study.of_pose(pose)
    frequency = analysis.phasors.omega[rows] / (2 * np.pi)
    response = single_record_response(analysis.phasors)[rows, joint]
    series = analysis.phasors.select(rows).series()
    return [Response(frequency[index], response[index]) for index in series]


def nominal(analysis: Analysis, pose: str, i: int, j: int) -> Response | None:
    """Return H_ij of what the controller assumes; None when the study does not say."""
    if analysis.study.nominal is None:
        return None
    return _model(analysis, pose, i, j, analysis.study.nominal)


def identified(analysis: Analysis, pose: str, i: int, j: int) -> Response | None:
    """Return H_ij of the identified model; None for an estimate that is no spring."""
    try:
        elasticity = analysis.fit.elasticity
    except JointIdError:
        return None
    return _model(analysis, pose, i, j, elasticity)


def band_of(frequency_hz: Floats) -> tuple[float, float]:
    """Return the measured band and a little more, Hz."""
    low, high = float(frequency_hz.min()), float(frequency_hz.max())
    margin = 1.12 if high > 1.5 * low else 2.0
    return low / margin, high * margin


def magnitude_limits(analysis: Analysis, pose: str, joint: int) -> tuple[float, float]:
    """Return the range of |H_jj| and of what single records show of it.

    With it the figures of a joint share their scale. A joint that stands still makes single responses
    of any size; they do not stretch the scale by more than a factor of ten.
    """
    models = (f(analysis, pose, joint, joint) for f in (nominal, identified))
    sizes = [np.abs(model.H) for model in models if model is not None]
    for matrices in (analysis.transfer_matrices, analysis.freed_transfer_matrices):
        if pose in matrices:
            sizes.append(np.abs(matrices[pose].H[:, joint, joint]))
    single = np.abs(single_record_response(analysis.phasors)[analysis.study.of_pose(pose), joint])
    every = np.concatenate(sizes) if sizes else single
    every = every[np.isfinite(every) & (every > 0)]
    if not every.size:
        return 1.0, 10.0
    low, high = float(every.min()), float(every.max())
    near = single[(single > low / 10) & (single < high * 10)]
    return min(low, float(near.min(initial=low))), max(high, float(near.max(initial=high)))


def phase_deg(response: Response, model: Response | None) -> Floats:
    """Return the phase on the branch that lies nearest to the model's, so that no point jumps by 360°.

    Parameters
    ----------
    response : Response
    model : Response, optional
        Without it the branch is that about 90°.

    Returns
    -------
    ndarray, shape (f,)
        Degrees.
    """
    angle = np.degrees(np.angle(response.H))
    centre: Floats | float = 90.0
    if model is not None:
        unwrapped = np.degrees(np.unwrap(np.angle(model.H)))
        unwrapped -= 360 * np.round((np.median(unwrapped) - 90) / 360)
        centre = np.interp(np.log(response.frequency_hz), np.log(model.frequency_hz), unwrapped)
    return np.asarray(centre + (angle - centre + 180) % 360 - 180)


def _model(analysis: Analysis, pose: str, i: int, j: int, elasticity: Elasticity) -> Response:
    """A curve over the measured band, dense enough for its peaks."""
    inertia = analysis.study.poses[pose] if pose else analysis.study.inertia
    band = band_of(analysis.phasors.omega[analysis.study.of_pose(pose)] / (2 * np.pi))
    peaks = [peak * np.geomspace(0.97, 1.03, _PEAK_POINTS) for peak in resonances(inertia, elasticity)]
    f = np.concatenate([np.geomspace(*band, _POINTS), *peaks])
    f = np.unique(f[(f >= band[0]) & (f <= band[1])])
    return Response(f, motor_response(2 * np.pi * f, inertia, elasticity)[:, i, j])
