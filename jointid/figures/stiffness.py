"""Stiffness of the gears: torsion curves, K over frequency and amplitude, residual of the model."""

from collections.abc import Sequence
from functools import partial
from typing import Literal

import numpy as np
import plotly.graph_objects as go

from jointid.answer import AT_MOTOR, StiffnessUnit, without
from jointid.arrays import Floats
from jointid.estimation.elasticity import ElasticityFit
from jointid.figures.style import Sketch, Trace, frequency_axis, joint_symbol, linear_axis, plain_text
from jointid.gears.harmonic_balance import law_stiffness
from jointid.joints import Elasticity


def dynamic_stiffness(
    fit: ElasticityFit,
    joint: int,
    nominal: Elasticity | None = None,
    *,
    unit: StiffnessUnit = AT_MOTOR,
    dark: bool = False,
) -> go.Figure:
    """b/a of one joint, from 0, by record: its real part should be flat at K, its imaginary part ωD."""
    sketch, scale, equations = Sketch(dark), unit.of_gear(joint), fit.equations
    f = equations.omega / (2 * np.pi)
    measured = scale.stiffness * equations.stiffness[:, joint]
    error = scale.stiffness * stiffness_error(fit)[:, joint]
    known = np.isfinite(measured)
    f, measured, error = f[known], measured[known], error[known]
    band = np.geomspace(f.min() / 1.12, f.max() * 1.12, 100) if f.size else np.array([1.0, 10.0])
    for name, dash, springs in (("nominal", "dash", nominal), ("identified", "solid", fit)):
        if springs is None:
            continue
        K, D = float(springs.K[joint]), float(springs.D[joint])
        flat = np.full(band.size, scale.stiffness * K)
        rising = 2 * np.pi * band * scale.stiffness * D
        shown = f"K = {flat[0]:.4g} {scale.unit}, D = {scale.torque**2 * D:.3g} N·m·s/rad"
        style: Trace = {"legendgroup": name, "hovertemplate": f"{name}: {shown}<extra></extra>"}
        sketch.line(band, flat, name, name, dash=dash, **style)
        sketch.line(band, rising, name, name, dash=dash, yaxis="y2", showlegend=False, **style)
    hover = "%{x:.4g} Hz<br>%{y:.4g} ± %{customdata:.2g} " + f"{scale.unit}<extra></extra>"
    shared: Trace = {"customdata": error, "error": {"array": error}, "hovertemplate": hover}
    shared["marker"] = {"symbol": joint_symbol(joint)}
    name = ", ".join(["each record", *filter(None, [without(fit)])])
    sketch.points(f, measured.real, name, "measured", **shared)
    shared |= {"yaxis": "y2", "showlegend": False}
    sketch.points(f, measured.imag, name, "measured", **shared)
    axes = [
        linear_axis(f"{part}{joint + 1} ({scale.unit})", rangemode="tozero")
        for part in ("Re b/a → K", "Im b/a → ωD")
    ]
    return sketch.figure(frequency_axis(f), *axes, height=460)


def stiffness_error(fit: ElasticityFit) -> np.ndarray:
    """Standard error of the real, and of the imaginary, part of each record's b/a, shape (r, n).

    b/a − (K + iωD) is the equation error over a, and half its variance lies in either part.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        V = np.einsum("rjj->rj", fit.equations.residual_covariance(fit.K, fit.D)).real
        return np.asarray(np.sqrt(V / 2) / np.abs(fit.equations.a))


_MOST_RECORDS = 10
"""Records drawn; more would hide each other."""
_MOST_TURNS = 12
"""Changes of sign of the deflection in a record that is drawn as a line."""
_SCALE = ("#7D5BA6", "#5B7DB1", "#2A9D8F", "#6DAF3F", "#B89A00")
"""Colours of rising frequency or amplitude, visible on black and on white."""
ColourBy = Literal["frequency", "amplitude"]


def torsion_curve(
    fit: ElasticityFit,
    joint: int,
    *,
    colour_by: ColourBy = "frequency",
    unit: StiffnessUnit = AT_MOTOR,
    dark: bool = False,
) -> go.Figure:
    """Torque of one gear over its deflection, a period of every record, and the fitted elastic law.

    The joint counts from 0; the records are coloured by frequency or amplitude.
    """
    sketch, curve, gear = Sketch(dark), fit.torsion_curves[joint], fit.gears[joint]
    scale = unit.of_gear(joint)
    wind_up, torque = scale.wind_up * curve.deflection_rad, scale.torque * curve.torque_Nm
    size, unit_of_size = curve.frequency_hz, "Hz"
    if colour_by == "amplitude":
        size, unit_of_size = scale.torque * curve.amplitude_Nm, "N·m"
    inks = record_colours(size, drawn_records(curve.amplitude_Nm))
    ends = list(inks)
    widths = 2 * scale.torque * curve.noise_beside(gear)
    named = dict.fromkeys(ends[:1], "")
    if len({f"{size[r]:.3g}" for r in ends}) > 1:
        named = {ends[0]: "from ", ends[-1]: "to "}
    for r, colour in inks.items():
        x, y, half = (np.append(v[r], v[r, 0]) for v in (wind_up, torque, widths))
        name = f"{named.get(r, '')}{size[r]:.3g} {unit_of_size}"
        record = f"{curve.frequency_hz[r]:.3g} Hz, {scale.torque * curve.amplitude_Nm[r]:.3g} N·m"
        measured = f"%{{x:.4g}} {scale.angle}<br>%{{y:.4g}} ± %{{customdata:.2g}} N·m"
        style: Trace = {"customdata": half, "showlegend": r in named}
        style["hovertemplate"] = f"{measured}<extra>{record}</extra>"
        if turns_often(x):
            sketch.points(x, y, name, colour, marker={"size": 4, "opacity": 0.5}, **style)
            continue
        band = {"fill": "toself", "hoverinfo": "skip", "showlegend": False, "opacity": 0.25}
        edge = np.concatenate([y + half, (y - half)[::-1]])
        both = np.concatenate([x, x[::-1]])
        sketch.line(both, edge, name, colour, width=0, fillcolor=colour, **band)
        sketch.line(x, y, name, colour, width=1.2, **style)
    tried = np.linspace(-gear.tried_rad, gear.tried_rad, 401)
    shown = scale.wind_up * tried
    hover = f"%{{x:.4g}} {scale.angle}<br>%{{y:.4g}} N·m<extra>fitted law</extra>"
    law = scale.torque * gear.torque(tried)
    sketch.line(shown, law, "fitted law", "identified", width=3, hovertemplate=hover)
    if gear.kind != "linear":
        slope, flat = scale.torque * gear.K * tried, {"dash": "dot", "hoverinfo": "skip"}
        sketch.line(shown, slope, "slope K", "quiet", width=1.5, **flat)
    across = linear_axis(f"Deflection ({scale.angle}, {scale.side})")
    upwards = linear_axis(f"Torque (N·m, {scale.side})")
    return sketch.figure(across, upwards, height=420, legend={"itemsizing": "constant"})  # small dots


def record_colours(size: Floats, drawn: Sequence[int]) -> dict[int, str]:
    """Colours of records by their frequency or amplitude, the smallest first."""
    height = np.log(np.maximum(size, np.finfo(float).tiny))
    order = sorted(drawn, key=lambda r: height[r])
    span = max(float(np.ptp(height[order])), 1e-9) if order else 1.0
    share = {r: float((height[r] - height[order[0]]) / span) for r in order}
    return {r: _SCALE[round(share[r] * (len(_SCALE) - 1))] for r in order}


def turns_often(deflection: Floats) -> bool:
    """Whether a record is a motion whose lines would hide each other: points show it better."""
    return bool(np.count_nonzero(np.diff(np.signbit(deflection))) > _MOST_TURNS)


def drawn_records(amplitude: Floats) -> list[int]:
    """Some records, spread over their torque amplitudes, the largest included, ascending."""
    order = np.argsort(amplitude)
    chosen = np.linspace(0, order.size - 1, min(_MOST_RECORDS, order.size)).round().astype(int)
    return [int(order[k]) for k in chosen]


def stiffness_over_amplitude(
    fit: ElasticityFit,
    joint: int,
    poses: Sequence[str] = (),
    *,
    unit: StiffnessUnit = AT_MOTOR,
    dark: bool = False,
) -> go.Figure:
    """Torque over deflection of every record's fundamental against its torque amplitude, by pose.

    The joint counts from 0; ``poses`` are those of the records, by default all the same. The law is
    evaluated at the deflection of every record: with backlash it depends on its waveform as well, and
    no line connects its values.
    """
    sketch, curve, gear = Sketch(dark), fit.torsion_curves[joint], fit.gears[joint]
    scale = unit.of_gear(joint)
    K, error, amplitude = curve.stiffness
    K, error, amplitude = scale.stiffness * K, scale.stiffness * error, scale.torque * amplitude
    names = np.array(poses if len(poses) == K.size else [""] * K.size)
    law, rising = scale.stiffness * law_stiffness(gear, curve.deflection_rad), np.argsort(amplitude)
    hover = f"%{{x:.3g}} N·m<br>%{{y:.4g}} {scale.unit}<extra>fitted law</extra>"
    open_circle = {"symbol": "circle-open", "size": 12}
    draw = partial(sketch.points, marker=open_circle) if gear.backlash_rad else sketch.line
    draw(amplitude[rising], law[rising], "fitted law", "identified", hovertemplate=hover)
    for k, pose in enumerate(dict.fromkeys(names.tolist())):
        at = names == pose
        name = plain_text(pose) or ("each record" if np.all(at) else "no pose stated")
        hover = f"%{{x:.3g}} N·m<br>%{{y:.4g}} ± %{{customdata:.2g}} {scale.unit}<extra></extra>"
        shared = {"customdata": error[at], "error": {"array": error[at]}, "hovertemplate": hover}
        symbol = {"symbol": joint_symbol(k), "size": 6}
        colour = "measured" if k == 0 else _SCALE[(2 * k) % len(_SCALE)]
        sketch.points(amplitude[at], K[at], name, colour, marker=symbol, **shared)
    across = linear_axis(f"Torque amplitude (N·m, {scale.side})", rangemode="tozero")
    return sketch.figure(across, linear_axis(f"K{joint + 1} of a record ({scale.unit})"), height=260)
