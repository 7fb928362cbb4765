"""Frequency responses ready to draw: measured points, models, and the scales they share.

The app's figures and the report's drawings take the same curves from here.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from jointid.analysis import NOT_USABLE, Analysis
from jointid.answer import without
from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.figures.style import joint_symbol
from jointid.joints import Elasticity, Inertia, motor_response, resonances
from jointid.transfer_matrix import TransferMatrix, single_record_response

_POINTS = 400
"""Points of a model's curve over the band."""
_PEAK_POINTS = 41
"""Additional points within 3 % of each resonance."""
_LEGEND_LENGTH = len("without friction and delay")


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


Source = Literal["measured", "nominal", "identified", "other"]


@dataclass(frozen=True, eq=False)
class Curve:
    """One frequency response of a figure."""

    name: str
    source: Source
    """Decides the colour."""
    response: Response
    symbol: str = ""
    """Marker of measured points; empty for a model's line."""


def element_name(i: int, j: int) -> str:
    """Return "H₁₂" for joints 0 and 1."""
    return f"H{i + 1}{j + 1}".translate(str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉"))


def measured(matrix: TransferMatrix, i: int, j: int) -> Response:
    """Return the points of H_ij by equations (17)-(18)."""
    error = matrix.standard_deviation[:, i, j] / np.sqrt(2)  # half of a complex variance lies along H
    return Response(matrix.omega / (2 * np.pi), matrix.H[:, i, j], error)


def removed_effects(analysis: Analysis) -> str:
    """Return the effects that figures remove from the data, in words; none of an unusable answer."""
    return "" if analysis.state == NOT_USABLE else without(analysis.fit)


def in_legend(removed: str) -> str:
    """Return removed effects as a phone's legend has room for them."""
    return removed if len(removed) <= _LEGEND_LENGTH else "without fitted effects"


def compensated_or_measured(analysis: Analysis, pose: str) -> tuple[TransferMatrix, str]:
    """Return the transfer matrix to compare with the model, and the effects removed, for a legend."""
    removed = removed_effects(analysis)
    if not removed or pose not in analysis.compensated_transfer_matrices:
        return analysis.transfer_matrices[pose], ""
    return analysis.compensated_transfer_matrices[pose], in_legend(removed)


def identified(analysis: Analysis, pose: str, i: int, j: int) -> Response | None:
    """Return H_ij of the identified model with its inertias; None for an unphysical estimate."""
    try:
        elasticity = analysis.fit.elasticity
    except JointIdError:
        return None
    return _model(analysis, pose, i, j, analysis.inertia(pose), elasticity)


def model_curves(analysis: Analysis, pose: str, i: int, j: int) -> list[Curve]:
    """Return nominal H_ij, with the given inertias, and identified H_ij, where they exist."""
    study, curves = analysis.study, []
    if study.nominal is not None:
        given = study.poses[pose] if pose else study.inertia
        assumed = _model(analysis, pose, i, j, given, study.nominal)
        curves.append(Curve("nominal model", "nominal", assumed))
    if (found := identified(analysis, pose, i, j)) is not None:
        curves.append(Curve("identified model", "identified", found))
    return curves


def element_curves(analysis: Analysis, pose: str, i: int, j: int) -> list[Curve]:
    """Return the models of H_ij, then its measured points by equations (17)-(18).

    Filled points are friction- and delay-compensated where these were identified; open points of a
    diagonal element are as measured. Off the diagonal, H_ji (open) follows H_ij: without errors they
    are equal.
    """
    curves = model_curves(analysis, pose, i, j)
    raw, (freed, removed) = analysis.transfer_matrices[pose], compensated_or_measured(analysis, pose)
    if i != j:
        for row, column, symbol in ((i, j, "circle"), (j, i, "square-open")):
            name = f"measured {element_name(row, column)}{removed and ', ' + removed}"
            curves.append(Curve(name, "measured", measured(freed, row, column), symbol))
        return curves
    if removed:
        curves.append(Curve("as measured", "measured", measured(raw, i, i), "circle-open"))
    name = removed or f"measured {element_name(i, i)}"
    return [*curves, Curve(name, "measured", measured(freed, i, i), "circle")]


def single_record_curves(analysis: Analysis, pose: str, joint: int) -> list[Curve]:
    """Return the models of H_jj, then acceleration over torque of a joint from each record alone."""
    curves, rows = model_curves(analysis, pose, joint, joint), analysis.study.of_pose(pose)
    frequency = analysis.phasors.omega[rows] / (2 * np.pi)
    H, series = single_record_response(analysis.phasors), analysis.phasors.select(rows).series()
    for k, index in enumerate(series):
        name = f"record {k + 1} of each frequency" if len(series) > 1 else "each record alone"
        response = Response(frequency[index], H[rows, joint][index])
        curves.append(Curve(name, "measured", response, f"{joint_symbol(k)}-open"))
    return curves


def phases_deg(curves: Sequence[Curve]) -> list[Floats]:
    """Return each curve's phase on the branch nearest to the last model, degrees."""
    model = next((curve.response for curve in reversed(curves) if not curve.symbol), None)
    return [phase_deg(curve.response, model) for curve in curves]


def measured_frequencies(curves: Sequence[Curve]) -> Floats:
    """Return the frequencies of all measured points, Hz."""
    return np.concatenate([c.response.frequency_hz for c in curves if c.symbol])


def band_of(frequency_hz: Floats) -> tuple[float, float]:
    """Return the measured band and a little more, Hz."""
    low, high = float(frequency_hz.min()), float(frequency_hz.max())
    margin = 1.12 if high > 1.5 * low else 2.0
    return low / margin, high * margin


def magnitude_limits(analysis: Analysis, pose: str, joint: int) -> tuple[float, float]:
    """Return the common range of |H_jj| and of its single-record responses, 1/(kg·m²).

    A joint at rest gives single-record responses of any size; they stretch the range by a factor of ten
    at most.
    """
    sizes = [np.abs(curve.response.H) for curve in model_curves(analysis, pose, joint, joint)]
    for matrices in (analysis.transfer_matrices, analysis.compensated_transfer_matrices):
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
    """Return the phase on the branch nearest to the model's, or to 90°, shape (f,), degrees.

    No point then jumps by 360°.
    """
    angle = np.degrees(np.angle(response.H))
    centre: Floats | float = 90.0
    if model is not None:
        unwrapped = np.degrees(np.unwrap(np.angle(model.H)))
        unwrapped -= 360 * np.round((np.median(unwrapped) - 90) / 360)
        centre = np.interp(np.log(response.frequency_hz), np.log(model.frequency_hz), unwrapped)
    return np.asarray(centre + (angle - centre + 180) % 360 - 180)


def _model(
    analysis: Analysis, pose: str, i: int, j: int, inertia: Inertia, elasticity: Elasticity
) -> Response:
    """A curve over the measured band, dense enough for its peaks."""
    omega = analysis.phasors.omega[analysis.study.of_pose(pose)]
    band = band_of((omega if omega.size else analysis.transfer_matrices[pose].omega) / (2 * np.pi))
    peaks = [peak * np.geomspace(0.97, 1.03, _PEAK_POINTS) for peak in resonances(inertia, elasticity)]
    f = np.concatenate([np.geomspace(*band, _POINTS), *peaks])
    f = np.unique(f[(f >= band[0]) & (f <= band[1])])
    return Response(f, motor_response(2 * np.pi * f, inertia, elasticity)[:, i, j])
