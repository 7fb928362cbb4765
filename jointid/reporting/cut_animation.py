"""The cut before and after in slow motion as one SVG file, which any browser plays without a script."""

from collections.abc import Sequence
from xml.etree.ElementTree import Element, tostring

import numpy as np

from jointid.arrays import Floats
from jointid.cut.outcome import millimetres
from jointid.cut.tracking import TrackingRun
from jointid.reporting.drawing import Drawing, Line, Text, to_svg

_FRAMES, _PATH_POINTS = 120, 600
"""Moments of the animation, and points of a drawn path."""
_SLOWER = 5.0
"""Duration over that of the cut."""
_PLAYED = 0.9
"""Share of the duration in which the tool moves; it then rests."""
_WIDTH, _MARGIN, _TOP = 320.0, 14.0, 62.0


def animated_cut(
    runs: Sequence[TrackingRun],
    names: Sequence[str],
    colours: Sequence[str],
    *,
    times: int = 1,
    title: str,
) -> str:
    """Draw cuts of one reference path by ``names`` and ``colours``, their errors ``times`` magnified.

    Who asks for reduced motion sees the finished cut.
    """
    end_s = float(runs[0].time_s[-1])
    moments = np.linspace(0.0, end_s, _FRAMES)
    tracks = [_drawn(run, np.linspace(0.0, end_s, _PATH_POINTS), times) for run in runs]
    paths = [runs[0].reference_m, *tracks]
    low, high = (end([end(path, axis=0) for path in paths], axis=0) for end in (np.min, np.max))
    scale = (_WIDTH - 2 * _MARGIN) / (high[0] - low[0])

    def pixels(path: Floats) -> Floats:
        return np.asarray((path - (low[0], high[1])) * (scale, -scale) + (_MARGIN, _TOP + _MARGIN))

    shown = [
        f"{name}: path error {millimetres(run.max_contour_error_m)}"
        for name, run in zip(names, runs, strict=True)
    ]
    bottom = _TOP + 2 * _MARGIN + scale * (high[1] - low[1])
    speed = f"1/{_SLOWER:g} of the speed" + f", errors × {times}" * (times > 1)
    bar = np.array([[_MARGIN, bottom + 6], [_MARGIN + 0.01 * scale, bottom + 6]])
    shapes = [
        Text(_MARGIN, 18, title, 11, bold=True),
        *(
            shape
            for k, (text, colour) in enumerate(zip(shown, colours, strict=True))
            for shape in (
                Line(np.array([[_MARGIN, 30 + 15 * k], [_MARGIN + 18, 30 + 15 * k]]), colour, 2.5),
                Text(_MARGIN + 24, 34 + 15 * k, text, 10),
            )
        ),
        Line(pixels(runs[0].reference_m[::4]), "#999999", 6.0, opacity=0.55),
        Line(bar, "#31333F", 1.5),
        Text(_MARGIN + 0.01 * scale + 8, bottom + 10, f"10 mm; {speed}", 9),
    ]
    still = Drawing(_WIDTH, bottom + 20, tuple(shapes), f"{title}. {'; '.join(shown)}.")
    svg, tag = to_svg(still, title=title), "</svg>"
    parts, rules = [], [f".run{{animation-duration:{_SLOWER * end_s / _PLAYED:.3f}s}}", _STYLE]
    for k, (run, track, colour) in enumerate(zip(runs, tracks, colours, strict=True)):
        path = pixels(track)
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
        begun = np.interp(moments, np.linspace(0.0, end_s, _PATH_POINTS), length / length[-1])
        rules.append(_keyframes(f"trace{k}", [f"stroke-dashoffset:{1 - x:.4f}" for x in begun]))
        tip = pixels(_drawn(run, moments, times))
        rules.append(
            _keyframes(f"tip{k}", [f"transform:translate({x:.1f}px,{y:.1f}px)" for x, y in tip])
        )
        d = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in path)
        line = Element("path", d=d, pathLength="1", fill="none", stroke=colour)
        line.attrib |= {"class": "run trace", "stroke-width": "2.5", "stroke-linejoin": "round"}
        line.set("style", f"animation-name:trace{k}")
        x, y = path[-1]
        dot = Element("circle", r="5", fill="#FFFFFF" if k == 0 else colour, stroke=colour)
        dot.attrib |= {"class": "run", "stroke-width": "2.5"}
        dot.set("style", f"animation-name:tip{k};transform:translate({x:.1f}px,{y:.1f}px)")
        parts += [line, dot]
    style = Element("style")
    style.text = "".join(rules)
    moving = "".join(tostring(each, "unicode") for each in (style, *parts))
    return svg.removesuffix(tag) + moving + tag


_STYLE = (
    ".run{animation-timing-function:linear;animation-iteration-count:infinite}"
    ".trace{stroke-dasharray:1}@media (prefers-reduced-motion:reduce){.run{animation:none!important}}"
)


def _drawn(run: TrackingRun, moments: Floats, times: int) -> Floats:
    """Positions at some moments, shape (m, 2), m, the distance from the reference magnified."""
    path = run.reference_m + times * (run.tool_m - run.reference_m)
    return np.stack([np.interp(moments, run.time_s, path[:, axis]) for axis in (0, 1)], axis=1)


def _keyframes(name: str, states: Sequence[str]) -> str:
    share = 100 * _PLAYED / (len(states) - 1)
    steps = "".join(f"{share * k:.2f}%{{{state}}}" for k, state in enumerate(states))
    return f"@keyframes {name}{{{steps}100%{{{states[-1]}}}}}"
