"""The picture of growth: time and memory over size, both logarithmic, with a line of slope one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from jointid.reporting.drawing import Drawing, Line, Marks, Text, to_svg

BLUE, ORANGE, GREY, INK = "#0072B2", "#D55E00", "#B8B8B8", "#31333F"
WIDTH, HEIGHT = 880.0, 232.0
PANEL = 148.0, 150.0
LEFT, TOP, GAP = 48.0, 38.0, 70.0

Points = Sequence[Mapping[str, Any]]


def draw(series: Mapping[str, Points]) -> str:
    """SVG of four panels: time over samples, records and joints, and memory over samples."""
    panels = [
        (
            "samples of one record",
            [
                ("phasors", series["samples"], "phasors", BLUE),
                ("from Parquet, in parts", series["samples, Parquet"], "phasors", ORANGE),
            ],
        ),
        (
            "records",
            [
                ("phasors", series["records"], "phasors", BLUE),
                ("K and D", series["records"], "identify", ORANGE),
            ],
        ),
        (
            "joints",
            [
                ("phasors", series["joints"], "phasors", BLUE),
                ("K and D", series["joints"], "identify", ORANGE),
            ],
        ),
    ]
    shapes: list[Line | Marks | Text] = [Text(LEFT, 18, "Time", 11, bold=True)]
    shapes.append(Text(LEFT + 34, 18, "dashed: linear growth", 9, colour="#7A7A7A"))
    for i, (title, curves) in enumerate(panels):
        shapes += _panel(LEFT + i * (PANEL[0] + GAP), title, curves, _time)
    left = LEFT + 3 * (PANEL[0] + GAP)
    shapes.append(Text(left, 18, "Memory, peak above imports", 11, bold=True))
    memory = [
        ("record in memory", series["samples"], "memory_MB", BLUE),
        ("from Parquet, in parts", series["samples, Parquet"], "memory_MB", ORANGE),
    ]
    shapes += _panel(left, "samples of one record", memory, _memory)
    largest = max(p["size"] for p in series["samples, Parquet"])
    description = (
        "Time of phasor extraction and of the estimate of K and D over the number of samples, records "
        f"and joints, and memory over the number of samples up to {largest:,.0f}; dashed lines show "
        "linear growth."
    )
    return on_white(to_svg(Drawing(WIDTH, HEIGHT, tuple(shapes), description)))


def on_white(svg: str) -> str:
    """A page may be dark; the ink is not."""
    head, rest = svg.split(">", 1)
    style = 'font-family="Roboto, Helvetica, Arial, sans-serif"'
    return f'{head} {style}><rect width="100%" height="100%" rx="6" fill="#FFFFFF"/>{rest}\n'


def _panel(
    left: float,
    title: str,
    curves: Sequence[tuple[str, Points, str, str]],
    label: Callable[[float], str],
) -> list[Line | Marks | Text]:
    drawn = [(name, _values(points, key), colour) for name, points, key, colour in curves]
    every = np.concatenate([values for _, values, _ in drawn])
    (x0, y0), (x1, y1) = np.floor(np.log10(every.min(axis=0))), np.ceil(np.log10(every.max(axis=0)))
    if x1 - x0 < 2:  # joints: one decade is more than they need
        x0, x1 = np.log10(every[:, 0].min()) - 0.05, np.log10(every[:, 0].max()) + 0.05
    width, height = PANEL

    def place(values: np.ndarray) -> np.ndarray:
        x = left + (np.log10(values[:, 0]) - x0) / (x1 - x0) * width
        y = TOP + height - (np.log10(values[:, 1]) - y0) / (y1 - y0) * height
        return np.stack([x, y], axis=1)

    shapes: list[Line | Marks | Text] = []
    for decade in np.arange(y0, y1 + 1):
        y = TOP + height - (decade - y0) / (y1 - y0) * height
        shapes.append(Line(np.array([[left, y], [left + width, y]]), "#E6E6E6", 0.6))
        shapes.append(Text(left - 5, y + 3, label(decade), 8, "end", colour=INK))
    for value in _ticks(every[:, 0], x0, x1):
        x = left + (np.log10(value) - x0) / (x1 - x0) * width
        shapes.append(Text(x, TOP + height + 13, _count(value), 8, "middle", colour=INK))
    shapes.append(Text(left + width / 2, TOP + height + 29, title, 9, "middle", colour=INK))
    for i, (name, values, colour) in enumerate(drawn):
        first, last = values[0], values[-1]
        guide = np.array([[first[0], last[1] * first[0] / last[0]], last])
        floor = 10**y0
        if guide[0, 1] < floor:  # cut off at the frame
            guide[0] = [last[0] * floor / last[1], floor]
        if i == 0:
            shapes.append(Line(place(guide), GREY, 1.0, (3, 3)))
        shapes.append(Line(place(values), colour, 1.4))
        shapes.append(Marks(place(values), colour, size=4.5))
        shapes.append(Text(left + 4, TOP + 8 + 12 * i, name, 9, colour=colour))
    return shapes


def _values(points: Points, key: str) -> np.ndarray:
    return np.array([[p["size"], p[key]] for p in points if p[key]], dtype=float)


def _ticks(sizes: np.ndarray, x0: float, x1: float) -> np.ndarray:
    decades = 10 ** np.arange(np.ceil(x0), np.floor(x1) + 1)
    return decades if decades.size > 2 else np.unique(sizes)


def _time(decade: float) -> str:
    """A power of ten of seconds."""
    for scale, unit in [(0, "s"), (-3, "ms"), (-6, "µs")]:
        if decade >= scale:
            return f"{10 ** (decade - scale):.0f} {unit}"
    return f"{10**decade:.0e} s"


def _memory(decade: float) -> str:
    """A power of ten of megabytes."""
    return f"{10 ** (decade - 3):.0f} GB" if decade >= 3 else f"{10**decade:g} MB"


def _count(value: float) -> str:
    if value < 1e4:
        return f"{value:.0f}"
    power = "".join("⁰¹²³⁴⁵⁶⁷⁸⁹"[int(c)] for c in f"{np.log10(value):.0f}")
    return f"10{power}"
