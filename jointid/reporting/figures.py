"""Figures 3-5 and 7 of the paper as drawings for the report.

Drawn without a plotting library: plotly exports through a browser, matplotlib adds tens of MB, and none
scales the height of a figure without scaling its texts, which the PDF needs to fill its pages.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jointid.analysis import Analysis
from jointid.answer import gear_terms
from jointid.arrays import Floats, true_runs
from jointid.cut.outcome import millimetres
from jointid.cut.tracking import TrackingRun
from jointid.figures.response_curves import (
    Curve,
    band_of,
    element_curves,
    element_name,
    magnitude_limits,
    measured_frequencies,
    phases_deg,
    single_record_curves,
)
from jointid.figures.stiffness import drawn_records, record_colours, turns_often
from jointid.figures.style import LIGHT
from jointid.reporting.drawing import Drawing, Line, Marks, Symbol, Text
from jointid.wording import minus, significant

PAGE_WIDTH = 482.0
"""Width of a figure over the whole page, points: A4 less 20 mm on either side."""

_GRID, _INK, _REFERENCE = "#DDDDDD", "#31333F", "#9A9A9A"
_CUT_COLOURS = (LIGHT.nominal, LIGHT.identified)
_MOST_POINTS = 1000
"""Points of a curve over time."""
_STRIDE = 4
"""Every fourth sample of a cut is drawn, one per millisecond."""
_MARKS: dict[str, tuple[Symbol, float]] = {
    "circle": ("circle", 2.8),
    "circle-open": ("ring", 3.6),
    "square-open": ("square", 3.0),
}
"""Symbol and diameter in points; others are drawn as circles."""


_Ticks = dict[float, str]
"""Labels by their place on an axis."""


@dataclass(frozen=True)
class _Frame:
    """A plot's box on the page and its axis limits (logarithms on a logarithmic axis)."""

    left: float
    top: float
    width: float
    height: float
    x: tuple[float, float]
    y: tuple[float, float]

    def place(self, x: Floats, y: Floats) -> Floats:
        """Points on the page, shape (k, 2)."""
        across = (x - self.x[0]) / (self.x[1] - self.x[0])
        up = (y - self.y[0]) / (self.y[1] - self.y[0])
        return np.column_stack([self.left + self.width * across, self.top + self.height * (1 - up)])


def element_figure(
    analysis: Analysis, joint: int, *, pose: str = "", width: float = PAGE_WIDTH / 2
) -> Drawing:
    """Figures 4 and 5: measured H_jj with ± one standard error, and the models.

    The joint counts from 0; the pose is one with a transfer matrix, "" for records without; the width in
    points.
    """
    curves = element_curves(analysis, pose, joint, joint)
    name = element_name(joint, joint)
    return _bode(curves, magnitude_limits(analysis, pose, joint), name, f"|{name}|", width)


def single_record_figure(analysis: Analysis, joint: int, *, pose: str = "") -> Drawing:
    """Figure 3: acceleration over torque of one joint from each record alone, beside the model of H_jj.

    The other joints' controllers are in it; drawn to the scale of ``element_figure``.
    """
    curves = single_record_curves(analysis, pose, joint)
    name = f"acceleration over torque of motor {joint + 1}"
    return _bode(curves, magnitude_limits(analysis, pose, joint), name, "Magnitude", PAGE_WIDTH)


def torsion_figure(analysis: Analysis, joint: int, *, width: float = PAGE_WIDTH / 2) -> Drawing:
    """Measured torque of one gear over its deflection, and the fitted law; the joint from 0.

    Coloured by frequency; thin lines bound ± two standard errors.
    """
    curve, gear = analysis.fit.torsion_curves[joint], analysis.fit.gears[joint]
    scale = analysis.unit.of_gear(joint)
    wind_up, torque = scale.wind_up * curve.deflection_rad, scale.torque * curve.torque_Nm
    drawn, band = drawn_records(curve.amplitude_Nm), 2 * scale.torque * curve.noise_beside(gear)
    tops = np.abs(wind_up), (np.abs(torque) + band)[drawn]
    x, y = (1.08 * top.max(initial=0.0) or 1.0 for top in tops)
    frame = _Frame(36.0, 6.0, width - 42.0, 130, (-x, x), (-y, y))
    shapes = _frame(frame, _linear_ticks(x), _linear_ticks(y))
    for r, colour in record_colours(curve.frequency_hz, drawn).items():
        if turns_often(wind_up[r]):
            shapes.append(Marks(frame.place(wind_up[r, ::2], torque[r, ::2]), colour, size=0.8))
            continue
        for width_of_line, step, away in ((0.2, 4, -band[r]), (0.2, 4, band[r]), (0.5, 2, 0 * band[r])):
            across, up = (np.append(v[::step], v[0]) for v in (wind_up[r], torque[r] + away))
            shapes.append(Line(frame.place(across, up), colour, width_of_line))
    tried = np.linspace(-gear.tried_rad, gear.tried_rad, 101)
    law = frame.place(scale.wind_up * tried, scale.torque * gear.torque(tried))
    shapes.append(Line(law, LIGHT.identified, 1.6))
    shapes.append(Text(width / 2 + 15, 156, f"Deflection ({scale.angle})", 7, "middle"))
    shapes.append(Text(8, 71, f"Torque of gear {joint + 1} (N·m)", 7, "middle", turned=True))
    terms = "; ".join(
        f"{name}: {value}" for name, value in gear_terms(analysis.fit, joint, analysis.unit).items()
    )
    return Drawing(
        width, 160, tuple(shapes), f"Torsion curve of joint {joint + 1}. {terms}.", least=0.75
    )


def deflection_figure(time_s: Floats, measured_rad: Floats, fitted_rad: Floats, joint: int) -> Drawing:
    """Deflection of one gear between its two encoders over time, above measured minus fitted.

    All shape (N,), the joint from 0; the constant offset is removed.
    """
    stride = -(-time_s.size // _MOST_POINTS)
    time = (time_s - time_s[0])[::stride]
    measured, fitted = (1e3 * (y - measured_rad.mean())[::stride] for y in (measured_rad, fitted_rad))
    shapes: list[Line | Marks | Text] = []
    top = 6.0
    for name, curves, height in (
        ("Deflection", ((measured, LIGHT.measured, 0.5), (fitted, LIGHT.identified, 1.2)), 90.0),
        ("Difference", ((measured - fitted, LIGHT.measured, 0.5),), 46.0),
    ):
        y = 1.08 * max(float(np.abs(values).max()) for values, *_ in curves) or 1.0
        box = _Frame(42.0, top, PAGE_WIDTH - 48.0, height, (0.0, float(time[-1])), (-y, y))
        ticks = _linear_ticks(float(time[-1]))
        shapes += _frame(
            box, ticks if name == "Difference" else dict.fromkeys(ticks, ""), _linear_ticks(y)
        )
        for values, colour, width in curves:
            shapes.append(Line(box.place(time, values), colour, width))
        shapes.append(Text(8, top + height / 2, f"{name} (mrad)", 7, "middle", turned=True))
        top += height + 10.0
    shapes.append(Text(PAGE_WIDTH / 2 + 18, top + 12, "Time (s)", 7, "middle"))
    rms = significant(float(np.std(measured - fitted)), 2)
    description = f"Deflection of the gear of joint {joint + 1} over time. Difference: {rms} mrad (rms)."
    return Drawing(PAGE_WIDTH, top + 16, tuple(shapes), description, least=0.75)


def _linear_ticks(limit: float) -> _Ticks:
    """About five round numbers between ± limit."""
    step = 10.0 ** np.floor(np.log10(limit))
    step *= next(f for f in (0.2, 0.5, 1.0, 2.0) if limit / (f * step) < 4 or f == 2.0)
    return {
        float(step * k): minus(f"{step * k:g}") for k in range(-int(limit / step), int(limit / step) + 1)
    }


def cut_figure(headings: Sequence[str], cuts: Mapping[str, Sequence[TrackingRun]]) -> Drawing:
    """Figure 7: cuts over the reference path, to one scale, with their largest path errors.

    ``headings`` are those of the cuts with nominal and with identified values; ``cuts`` both by label.
    """
    runs = [run for pair in cuts.values() for run in pair]
    paths = [path[::_STRIDE] for run in runs for path in (run.reference_m, run.tool_m)]
    low = np.min([p.min(axis=0) for p in paths], axis=0)
    high = np.max([p.max(axis=0) for p in paths], axis=0)
    cell = PAGE_WIDTH / len(cuts)
    scale = min((cell - 24) / (high[0] - low[0]), 118 / (high[1] - low[1]))
    size = scale * (high - low)
    shapes: list[Line | Marks | Text] = []
    top, errors = 0.0, []
    for row, (heading, colour) in enumerate(zip(headings, _CUT_COLOURS, strict=True)):
        sample = np.array([[0.0, top + 7.5], [16.0, top + 7.5]])
        shapes += [Line(sample, colour, 1.6), Text(22, top + 10, heading, 8, bold=True)]
        top += 20
        for column, (label, pair) in enumerate(cuts.items()):
            run = pair[row]
            left = cell * column + (cell - size[0]) / 2
            for path, ink, stroke in ((run.reference_m, _REFERENCE, 3.0), (run.tool_m, colour, 0.9)):
                xy = (path[::_STRIDE] - (low[0], high[1])) * (scale, -scale) + (left, top)
                shapes.append(Line(xy, ink, stroke, opacity=0.6 if ink == _REFERENCE else 1.0))
            middle, below = cell * (column + 0.5), top + size[1]
            error = millimetres(run.max_contour_error_m)
            errors.append(f"{heading}, {label}: {error}")
            shapes.append(Text(middle, below + 12, error, 8.5, "middle", bold=True))
            shapes.append(Text(middle, below + 22, label, 7.5, "middle"))
        top += size[1] + 34
    ten = 0.01 * scale
    begin, end = PAGE_WIDTH - ten, PAGE_WIDTH
    bar = [[begin, 3.0], [begin, 7.0], [begin, 5.0], [end, 5.0], [end, 3.0], [end, 7.0]]
    shapes.append(Line(np.array(bar), _INK, 0.7))
    shapes.append(Text(end - ten / 2, 15, "10 mm", 7, "middle"))
    description = f"Cut paths with their largest path errors. {'; '.join(errors)}."
    return Drawing(PAGE_WIDTH, top - 8, tuple(shapes), description, to_scale=True, least=0.8)


def _bode(
    curves: list[Curve], limits: tuple[float, float], name: str, label: str, width: float
) -> Drawing:
    """Magnitude above phase, on a common logarithmic frequency axis."""
    measured = measured_frequencies(curves)
    span = band_of(measured)
    x = (float(np.log10(span[0])), float(np.log10(span[1])))
    left, right = 36.0, 6.0
    keys, legend = _legend(curves, left, width - right)
    inner = width - left - right
    phases = phases_deg(curves)
    known = np.concatenate([p[np.isfinite(p)] for p in phases])
    lowest, highest = float(known.min(initial=-90.0)), float(known.max(initial=180.0))
    size = _Frame(left, legend, inner, 86, x, (np.log10(limits[0] / 1.3), np.log10(limits[1] * 1.3)))
    turn = _Frame(left, legend + 94, inner, 46, x, (lowest - 15, highest + 15))
    shapes: list[Line | Marks | Text] = [*keys]
    ticks = _log_ticks(1, 2, 3, 5)
    magnitudes = _log_ticks(*((1, 2, 5) if size.y[1] - size.y[0] < 2.5 else (1,)))
    shapes += _frame(size, dict.fromkeys(ticks, ""), magnitudes)
    shapes += _frame(turn, ticks, {k: minus(f"{k}") for k in range(-720, 721, 90)})
    for curve, phase in zip(curves, phases, strict=True):
        f = np.log10(curve.response.frequency_hz)
        with np.errstate(divide="ignore", invalid="ignore"):
            logarithm = np.log10(np.abs(curve.response.H))
        relative = curve.response.relative_error if curve.symbol == "circle" else None
        below = above = half = None
        if relative is not None:
            below, above = np.log10(np.maximum(1 - relative, 0.05)), np.log10(1 + relative)
            half = np.degrees(np.minimum(relative, np.pi))
        shapes += _plot(size, curve, f, logarithm, below, above)
        shapes += _plot(turn, curve, f, phase, None if half is None else -half, half)
    bottom = turn.top + turn.height
    shapes.append(Text(left + inner / 2, bottom + 20, "Frequency (Hz)", 7, "middle"))
    middle = size.top + size.height / 2
    shapes.append(Text(8, middle, f"{label} (1/(kg·m²))", 7, "middle", turned=True))
    shapes.append(Text(8, turn.top + turn.height / 2, "Phase (°)", 7, "middle", turned=True))
    models = " and ".join(c.source for c in curves if not c.symbol) or "none"
    description = f"{name} over frequency: {measured.size} measured points; models: {models}."
    return Drawing(
        width, bottom + 24, tuple(shapes), f"Magnitude and phase of {description}", least=0.75
    )


def _frame(frame: _Frame, x: _Ticks, y: _Ticks) -> list[Line | Marks | Text]:
    """Grid lines and labels of the ticks within the axes."""
    shapes: list[Line | Marks | Text] = []
    bottom = frame.top + frame.height
    across, up = np.array(frame.x), np.array(frame.y)
    for tick, label in x.items():
        if frame.x[0] <= tick <= frame.x[1]:
            line = frame.place(np.full(2, tick), up)
            shapes += [Line(line, _GRID, 0.5), Text(float(line[0, 0]), bottom + 9, label, 6.5, "middle")]
    for tick, label in y.items():
        if frame.y[0] <= tick <= frame.y[1]:
            line = frame.place(across, np.full(2, tick))
            text = Text(frame.left - 3, float(line[0, 1]) + 2.3, label, 6.5, "end")
            shapes += [Line(line, _GRID, 0.5), text]
    corners = frame.place(across[[0, 1, 1, 0, 0]], up[[0, 0, 1, 1, 0]])
    shapes.append(Line(corners, "#888888", 0.6))
    return [s for s in shapes if not (isinstance(s, Text) and not s.text)]


def _plot(
    frame: _Frame, curve: Curve, x: Floats, y: Floats, below: Floats | None, above: Floats | None
) -> list[Line | Marks | Text]:
    """Points with error bars from y + ``below`` to y + ``above``, or lines, within the axes."""
    inside = np.isfinite(y) & (y >= frame.y[0]) & (y <= frame.y[1])
    inside &= (x >= frame.x[0]) & (x <= frame.x[1])
    if not curve.symbol:
        runs = (slice(a, b) for a, b in true_runs(inside) if b - a > 1)
        return [_drawn(curve, frame.place(x[run], y[run])) for run in runs]
    shapes: list[Line | Marks | Text] = []
    if below is not None and above is not None:
        for k in np.flatnonzero(inside):
            ends = np.clip([y[k] + below[k], y[k] + above[k]], *frame.y)
            at = frame.place(np.full(2, x[k]), ends)
            if abs(at[1, 1] - at[0, 1]) > 2.6:  # the mark hides shorter ones
                shapes.append(Line(at, getattr(LIGHT, curve.source), 0.7))
    return [*shapes, _drawn(curve, frame.place(x[inside], y[inside]))]


def _drawn(curve: Curve, points: Floats, width: float = 1.2) -> Marks | Line:
    """A curve's points by its symbol, or its line."""
    colour = getattr(LIGHT, curve.source)
    if not curve.symbol:
        return Line(points, colour, width, (4, 2) if curve.source == "nominal" else ())
    return Marks(points, colour, *_MARKS.get(curve.symbol, _MARKS["circle"]))


def _legend(
    curves: Sequence[Curve], left: float, right: float
) -> tuple[list[Line | Marks | Text], float]:
    """Legend between two edges, in as many lines as needed; and its height."""
    shapes: list[Line | Marks | Text] = []
    at, down = left, 5.0
    for curve in curves:
        needed = 16 + 4.0 * len(curve.name)  # of the widest usual font, DejaVu Sans
        if at > left and at + needed > right:
            at, down = left, down + 10
        key = [[at + 8, down]] if curve.symbol else [[at, down], [at + 13, down]]
        shapes.append(_drawn(curve, np.array(key), 1.4))
        shapes.append(Text(at + 16, down + 2.4, curve.name, 7))
        at += needed + 7
    return shapes, down + 9


def _log_ticks(*steps: int) -> _Ticks:
    """Labels of some steps of every decade by their logarithms."""
    ticks = [m * 10.0**d for d in range(-12, 10) for m in steps]
    return {float(np.log10(tick)): f"{tick:g}" for tick in ticks}
