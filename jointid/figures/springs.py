"""The springs: dynamic stiffness of every record, and the residual of the model."""

import numpy as np
import plotly.graph_objects as go

from jointid.answer import AT_MOTOR, StiffnessUnit
from jointid.estimation.elasticity import ElasticityFit
from jointid.figures.style import (
    Axis,
    colours,
    figure,
    frequency_axis,
    joint_symbol,
    line,
    linear_axis,
    log_axis,
    points,
)
from jointid.joints import Elasticity


def dynamic_stiffness(
    fit: ElasticityFit,
    joint: int,
    nominal: Elasticity | None = None,
    *,
    unit: StiffnessUnit = AT_MOTOR,
    dark: bool = False,
) -> go.Figure:
    """b/a of one joint, record by record: its real part should be flat at K, its imaginary part ωD.

    Parameters
    ----------
    fit : ElasticityFit
    joint : int
        From 0.
    nominal : Elasticity, optional
        Nominal values, drawn as well.
    unit : StiffnessUnit, optional
        Of both parts.
    """
    ink, scale = colours(dark), unit.of_gear(joint)
    equations = fit.equations
    f = equations.omega / (2 * np.pi)
    measured = scale.stiffness * equations.stiffness[:, joint]
    error = scale.stiffness * stiffness_error(fit)[:, joint]
    known = np.isfinite(measured)
    f, measured, error = f[known], measured[known], error[known]
    band = np.geomspace(f.min() / 1.12, f.max() * 1.12, 100) if f.size else np.array([1.0, 10.0])
    K, D = float(fit.K[joint]), float(fit.D[joint])
    models = [("identified", ink.identified, "solid", K, D)]
    if nominal is not None:
        models.insert(0, ("nominal", ink.nominal, "dash", nominal.K[joint], nominal.D[joint]))
    traces = []
    for name, colour, dash, k, d in models:
        style = {"line": {"dash": dash}, "legendgroup": name}
        flat = np.full(band.size, scale.stiffness * k)
        rising = 2 * np.pi * band * scale.stiffness * d
        shown = f"K = {flat[0]:.4g} {scale.unit}, D = {scale.torque**2 * d:.3g} N·m·s/rad"
        value = f"{name}: {shown}<extra></extra>"
        style["hovertemplate"] = value
        traces.append(line(band, flat, name, colour, **style))
        traces.append(line(band, rising, name, colour, yaxis="y2", showlegend=False, **style))
    hover = "%{x:.4g} Hz<br>%{y:.4g} ± %{customdata:.2g} " + f"{scale.unit}<extra></extra>"
    shared = {"customdata": error, "error": {"array": error}, "hovertemplate": hover}
    dots = {"marker": {"symbol": joint_symbol(joint)}}
    traces.append(points(f, measured.real, "each record", ink.measured, **shared, **dots))
    lower = {"yaxis": "y2", "showlegend": False}
    traces.append(points(f, measured.imag, "each record", ink.measured, **lower, **shared, **dots))
    axes = [
        linear_axis(f"{part}{joint + 1} ({scale.unit})", rangemode="tozero")
        for part in ("Re b/a → K", "Im b/a → ωD")
    ]
    return figure(traces, frequency_axis(f), *axes, height=460, dark=dark)


def stiffness_error(fit: ElasticityFit) -> np.ndarray:
    """Standard error of the real, and of the imaginary, part of each record's b/a, shape (r, n).

    b/a − (K + iωD) is the equation error over a, and half its variance lies in either part.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        V = np.einsum("rjj->rj", fit.equations.residual_covariance(fit.K, fit.D)).real
        return np.asarray(np.sqrt(V / 2) / np.abs(fit.equations.a))


def unexplained_torque(fit: ElasticityFit, joint: int, *, dark: bool = False) -> go.Figure:
    """Torque of one joint that the model leaves unexplained, against what noise alone would leave."""
    ink = colours(dark)
    f = fit.equations.omega / (2 * np.pi)
    left, noise = np.abs(fit.residual[:, joint]), fit.residual_noise[:, joint]
    dash = {"symbol": "line-ew-open", "size": 12, "line": {"width": 2, "color": ink.quiet}}
    traces = []
    for name, torque, colour, marker in (
        ("noise alone", noise, ink.quiet, dash),
        ("left unexplained", left, ink.measured, {"symbol": joint_symbol(joint)}),
    ):
        hover = f"%{{x:.4g}} Hz<br>%{{y:.3g}} N·m<extra>{name}</extra>"
        size = np.maximum(torque, 1e-300)
        traces.append(points(f, size, name, colour, marker=marker, hovertemplate=hover))
    sizes = np.abs(np.concatenate([fit.residual.ravel(), fit.residual_noise.ravel()]))
    sizes = sizes[np.isfinite(sizes) & (sizes > 1e-30)]
    more: Axis = {}
    if sizes.size:  # the same for every joint
        more["range"] = [float(np.log10(sizes.min() / 1.5)), float(np.log10(sizes.max() * 1.5))]
    axis = log_axis("Motor torque (N·m)", **more)
    return figure(traces, frequency_axis(f), axis, height=320, dark=dark)
