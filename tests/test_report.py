"""The report: all digits of the fit, no external resources, reproducible bytes."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from html import escape
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from hostile import hostile_study
from plants import PAPER, PARALLELOGRAM

from jointid import (
    Analysis,
    Controller,
    Excitation,
    Measurement,
    MotorFriction,
    SineRecord,
    Study,
    analyse,
    load_study,
    save_study,
    simulate_records,
)
from jointid.cut.outcome import ZONES_M, millimetres, predicted_cut, study_outcome
from jointid.cut.rectangle import rectangle
from jointid.cut.robot import CUTTING_POINT_M
from jointid.files.digest import study_digest
from jointid.reporting.blocks import Figure, Paragraph, Report, Section, Table
from jointid.reporting.drawing import Drawing, Line, Marks, Text, to_svg
from jointid.reporting.evidence import cut_blocks
from jointid.reporting.figures import (
    PAGE_WIDTH,
    cut_figure,
    element_figure,
    single_record_figure,
    torsion_figure,
)
from jointid.reporting.report import make_report, to_html, to_pdf
from jointid.wording import with_error

VOID = {"meta", "br", "hr", "img", "link", "input"}


class Outline(HTMLParser):
    """Checks that every element is closed, and collects what a browser would fetch or run."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.fetched: list[str] = []
        self.headings: list[str] = []
        self.images = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        self.images += tag == "svg"
        self.fetched += [
            f"{tag} {k}={v}" for k, v in attrs if k in ("src", "href", "xlink:href", "data")
        ]
        if tag in ("script", "iframe", "object", "link", "base"):
            self.fetched.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("h1", "h2"):
            self.headings.append(data)


def outline(html: str) -> Outline:
    parser = Outline()
    parser.feed(html)
    assert parser.open == []
    return parser


@pytest.fixture(scope="module")
def report(analyses: dict[int, Analysis]) -> Report:
    return make_report(analyses[2])


@pytest.fixture(scope="module")
def pdf(report: Report) -> bytes:
    return to_pdf(report)


@pytest.fixture(scope="module")
def html(report: Report) -> str:
    return to_html(report)


def test_html_loads_nothing_from_the_network(html: str) -> None:
    seen = outline(html)
    assert seen.fetched == []
    assert "@import" not in html
    assert "url(" not in html
    assert set(re.findall(r"https?://[^\"' <>]+", html)) == {"http://www.w3.org/2000/svg"}
    assert len(html) < 400_000


def test_html_holds_the_answer_with_all_its_digits(html: str, analyses: dict[int, Analysis]) -> None:
    fit = analyses[2].fit
    for value, error in zip([*fit.K, *fit.D], fit.standard_error, strict=True):
        assert with_error(float(value), float(error)) in html
        assert repr(float(value)) in html
        assert repr(float(error)) in html
    assert study_digest(analyses[2].study) in html
    assert "simulated" in html
    for finding in analyses[2].findings:
        assert escape(finding.title) in html


def test_sections_figures_and_path_errors_are_there(html: str, analyses: dict[int, Analysis]) -> None:
    seen = outline(html)
    assert seen.headings[0] == "Test cell with 2 joint(s)"
    assert seen.headings[1:] == [
        "Answer",
        "Verdict",
        "Torsion curves of the gears",
        "Model and measurement",
        "Path error before and after",
        "Data and settings",
        "Records",
        "Values with all digits",
    ]
    assert seen.images == 6  # two torsion curves, Figures 3, 4, 5 and 7 of the paper
    outcome = study_outcome(analyses[2])
    assert outcome is not None
    assert f"{millimetres(outcome.before_m)} before" in html
    assert millimetres(outcome.after_m) in html


def test_records_of_the_study_are_listed(html: str, studies: dict[int, Study]) -> None:
    for record in studies[2].records:
        assert record.label in html


def test_a_study_from_a_file_gives_the_same_bytes(
    studies: dict[int, Study], tmp_path: Path, analyses: dict[int, Analysis]
) -> None:
    """A cut, too, in a long run: the test below."""
    save_study(studies[2], tmp_path / "study.zip")
    again = make_report(analyse(load_study(tmp_path / "study.zip")), cut=False)
    whole = make_report(analyses[2], cut=False)
    assert to_html(again) == to_html(whole)
    assert to_pdf(again) == to_pdf(whole)


def test_another_process_gives_the_same_bytes(
    studies: dict[int, Study], pdf: bytes, html: str, tmp_path: Path
) -> None:
    """Of the same study, read from a file."""
    save_study(studies[2], tmp_path / "study.zip")
    program = (
        "import sys; from jointid import load_study, analyse\n"
        "from jointid.reporting.report import make_report, to_html, to_pdf\n"
        "r = make_report(analyse(load_study(sys.argv[1])))\n"
        "sys.stdout.buffer.write(to_pdf(r) + to_html(r).encode())"
    )
    command = [sys.executable, "-c", program, str(tmp_path / "study.zip")]
    other_order = os.environ | {"PYTHONHASHSEED": "1"}  # of sets
    theirs = subprocess.run(command, capture_output=True, check=True, env=other_order).stdout
    assert theirs == pdf + html.encode()


def test_pdf_holds_the_answer(pdf: bytes, analyses: dict[int, Analysis], tmp_path: Path) -> None:
    assert pdf.startswith(b"%PDF")
    assert len(pdf) < 300_000
    assert pdf.count(b"/FontFile2") == 2  # both weights embedded
    if shutil.which("pdftotext") is None:
        pytest.skip("There is no pdftotext on the PATH.")
    (tmp_path / "r.pdf").write_bytes(pdf)
    text = subprocess.run(
        ["pdftotext", "-layout", str(tmp_path / "r.pdf"), "-"], capture_output=True, check=True
    ).stdout.decode()
    fit = analyses[2].fit
    for value, error in zip([*fit.K, *fit.D], fit.standard_error, strict=True):
        assert with_error(float(value), float(error)) in text
        assert repr(float(value)) in text
    assert "page 1" in text
    assert "N·m·s/rad" in text


@pytest.mark.parametrize("n", [1, 3])
def test_other_numbers_of_joints_have_no_cut(analyses: dict[int, Analysis], n: int) -> None:
    made = make_report(analyses[n])
    assert "Path error before and after" not in [section.title for section in made.sections]
    drawings = [d for s in made.sections for b in s.blocks if isinstance(b, Figure) for d in b.drawings]
    assert len(drawings) == {1: 2, 3: 7}[n]  # a torsion curve of each gear among them
    outline(to_html(made))
    assert to_pdf(made).startswith(b"%PDF")


def test_names_of_a_study_are_escaped_in_html_and_pdf(studies: dict[int, Study]) -> None:
    made = make_report(analyse(hostile_study(studies[2])))
    html = to_html(made)
    assert outline(html).fetched == []
    assert not re.search(r"<(a|b|img|image|span)\b", html)
    pdf = to_pdf(made)
    assert pdf.startswith(b"%PDF")
    assert b"/URI" not in pdf
    assert b"/Subtype /Image" not in pdf


def test_texts_of_the_user_are_escaped(analyses: dict[int, Analysis]) -> None:
    hostile = 'A <script>alert("1")</script> & <b>cell</b> \x00 Ж 漢 --'
    study = replace(analyses[1].study, name=hostile, description=hostile)
    made = make_report(replace(analyses[1], study=study))
    assert outline(to_html(made)).fetched == []
    assert escape("<script>") in to_html(made)
    assert to_pdf(made).startswith(b"%PDF")


def test_without_nominal_values_there_is_nothing_to_compare(analyses: dict[int, Analysis]) -> None:
    study = replace(analyses[1].study, nominal=None)
    made = to_html(make_report(replace(analyses[1], study=study)))
    assert ">nominal<" not in made
    assert ">change<" not in made


def test_state_and_entries_are_stated(analyses: dict[int, Analysis]) -> None:
    study = replace(analyses[2].study, gear_ratio=[100.0, -90.0], assumed=("direction of joint 2",))
    html = to_html(make_report(replace(analyses[2], study=study), cut=False))
    assert "<h2>Answer</h2>\n<p>Usable" in html
    assert "100, −90, given" in html
    entries = html.partition("As entered")[0].rpartition("Assumed, not confirmed")[2]
    assert "direction of joint 2" in entries
    assert "5 %, assumed where nothing is stated" in html
    assert "not stated: assumed exact" in html


def test_an_unphysical_study_is_reported_as_unusable() -> None:
    records = simulate_records(PARALLELOGRAM, PAPER, [3.0, 12.0], excitation=Excitation(duration_s=1.0))
    turned = [replace_torque(record, -1.0) for record in records]
    analysis = analyse(Study(turned, PARALLELOGRAM))
    made = to_html(make_report(analysis))
    assert "Problem:" in made
    assert "No cut is shown" in made
    assert "Cut paths" not in made
    assert repr(float(analysis.fit.K[0])) not in made


def replace_torque(record: SineRecord, factor: float) -> SineRecord:
    return SineRecord(
        record.frequency_hz, record.time_s, record.theta_rad, factor * record.tau_Nm, label=record.label
    )


def test_long_tables_break_over_pages() -> None:
    rows = tuple((f"record {k}", str(k)) for k in range(200))
    made = Report("Long", "", (Section("Rows", (Table(("record", "number"), rows),)),), "foot")
    assert to_pdf(made).count(b"/Type /Page\n") >= 3


def left_empty(data: bytes, folder: Path) -> list[float]:
    """Share of each page's room under its last line, the footer not counted."""
    if shutil.which("pdftotext") is None:
        pytest.skip("There is no pdftotext on the PATH.")
    (folder / "r.pdf").write_bytes(data)
    command = ["pdftotext", "-bbox", str(folder / "r.pdf"), "-"]
    text = subprocess.run(command, capture_output=True, check=True).stdout.decode()
    pages = text.split("<page ")[1:]
    lowest = [[float(y) for y in re.findall(r'yMax="([\d.]+)">', page)] for page in pages]
    return [1 - (max(y for y in page if y < 795) - 50) / 742 for page in lowest]


@pytest.mark.parametrize("n", [1, 2, 3])
def test_no_page_but_the_last_is_mostly_empty(
    analyses: dict[int, Analysis], pdf: bytes, n: int, tmp_path: Path
) -> None:
    """Figures shrink a little, tables break."""
    empty = left_empty(pdf if n == 2 else to_pdf(make_report(analyses[n])), tmp_path)
    assert len(empty) > 1
    assert max(empty[:-1]) < 0.35


@pytest.mark.parametrize("lines", [0, 20, 35, 38, 42, 50])
def test_a_figure_shrinks_before_it_leaves_a_page_empty(
    analyses: dict[int, Analysis], lines: int, tmp_path: Path
) -> None:
    """For any position of the figures."""
    figure = Figure((element_figure(analyses[2], 0, width=PAGE_WIDTH),), "Figure.")
    text = tuple(Paragraph("A line.") for _ in range(lines))
    made = Report("Figures", "", (Section("Here", (*text, *([figure] * 6))),), "foot")
    assert max(left_empty(to_pdf(made), tmp_path)[:-1]) < 0.3


def test_a_caption_stays_with_the_end_of_its_table(tmp_path: Path) -> None:
    if shutil.which("pdftotext") is None:
        pytest.skip("There is no pdftotext on the PATH.")
    for count in range(44, 56):
        rows = tuple((f"record {k}", str(k)) for k in range(count))
        table = Table(("record", "number"), rows, "The caption.")
        (tmp_path / "r.pdf").write_bytes(to_pdf(Report("", "", (Section("Rows", (table,)),), "")))
        command = ["pdftotext", "-layout", str(tmp_path / "r.pdf"), "-"]
        text = subprocess.run(command, capture_output=True, check=True).stdout.decode()
        last = next(page for page in text.split("\f") if "The caption." in page)
        assert last.count("record ") >= 4


def test_a_drawing_of_smaller_height_keeps_its_scale() -> None:
    line = Line(np.array([[0.0, 0.0], [30.0, 40.0]]), "#000000")
    shapes = (line, Text(10, 20, "here", 7))
    for to_scale, end in ((True, (24, 32)), (False, (30, 32))):
        lower = Drawing(100, 50, shapes, "", to_scale).lowered(0.8)
        assert (lower.width, lower.height) == (80 if to_scale else 100, 40)
        drawn, text = lower.shapes
        assert isinstance(drawn, Line)
        assert isinstance(text, Text)
        assert tuple(drawn.points[1]) == end
        assert (text.y, text.size) == (16, 7)


def test_empty_paragraphs_and_wide_tables_are_set() -> None:
    wide = Table(
        tuple(f"column {k}" for k in range(14)), (tuple("0.123456 ± 0.000012" for _ in range(14)),)
    )
    made = Report("", "", (Section("Wide", (Paragraph(""), wide)),), "")
    assert to_pdf(made).startswith(b"%PDF")
    outline(to_html(made))


# --- drawings


def marks(drawing: Drawing) -> list[Marks]:
    return [shape for shape in drawing.shapes if isinstance(shape, Marks) and len(shape.points) > 1]


def test_points_are_drawn_at_the_measured_values(analyses: dict[int, Analysis]) -> None:
    """On logarithmic axes the place is linear in log f and log |H|, and linear in the phase."""
    analysis = analyses[2]
    matrix = analysis.transfer_matrices[""]
    for joint in (0, 1):
        H = matrix.H[:, joint, joint]
        magnitude, phase = marks(element_figure(analysis, joint))
        assert len(magnitude.points) == len(phase.points) == 6
        for x, y in (
            (np.log10(matrix.omega), magnitude.points[:, 0]),
            (np.log10(np.abs(H)), magnitude.points[:, 1]),
            (np.degrees(np.angle(H)), phase.points[:, 1]),
        ):
            slope, offset = np.polyfit(x, y, 1)
            np.testing.assert_allclose(slope * x + offset, y, atol=1e-6)


def test_the_identified_line_runs_through_the_points(analyses: dict[int, Analysis]) -> None:
    drawing = element_figure(analyses[2], 0)
    lines = [
        s for s in drawing.shapes if isinstance(s, Line) and s.colour == "#0072B2" and len(s.points) > 50
    ]
    x, y = lines[0].points.T
    points = marks(drawing)[0].points
    assert np.abs(np.interp(points[:, 0], x, y) - points[:, 1]).max() < 2.0


def test_measured_torsion_loops_are_closed_between_their_bounds(analyses: dict[int, Analysis]) -> None:
    curve = analyses[2].fit.torsion_curves[0]
    loops = [s for s in torsion_figure(analyses[2], 0).shapes if isinstance(s, Line) and s.width == 0.5]
    loops = [loop for loop in loops if len(loop.points) == curve.torque_Nm[0, ::2].size + 1]
    bounds = [s for s in torsion_figure(analyses[2], 0).shapes if isinstance(s, Line) and s.width == 0.2]
    assert len(loops) == min(10, curve.torque_Nm.shape[0])
    assert len(bounds) == 2 * len(loops)
    for k, loop in enumerate(loops):
        low, high = (each.points for each in bounds[2 * k : 2 * k + 2])
        np.testing.assert_array_equal(loop.points[0], loop.points[-1])
        assert low[0, 1] > loop.points[0, 1] > high[0, 1]  # downwards on the page
    assert len({loop.colour for loop in loops}) > 2


def test_every_record_alone_is_drawn(analyses: dict[int, Analysis]) -> None:
    drawn = marks(single_record_figure(analyses[2], 0))
    assert [m.symbol for m in drawn] == ["ring", "ring", "square", "square"]
    assert all(len(m.points) == 6 for m in drawn)


def test_friction_compensated_points_are_filled_and_lie_on_the_line() -> None:
    records = simulate_records(
        PARALLELOGRAM,
        PAPER,
        [4.0, 9.0, 19.0, 29.0],
        excitation=Excitation(periods=8.0, velocity_rad_s=8.0),
        controller=Controller(sample_rate_hz=2000.0),
        friction=MotorFriction(coulomb=[0.3, 0.06], step_s=5e-4),
        measurement=Measurement(torque_noise_Nm=0.005),
    )
    drawing = element_figure(analyse(Study(records, PARALLELOGRAM)), 1)
    curves = [s for s in drawing.shapes if isinstance(s, Line) and s.colour == "#0072B2"]
    x, y = next(curve for curve in curves if len(curve.points) > 50).points.T
    away = {}
    for group in marks(drawing)[::2]:  # magnitudes; every other group is a phase
        away[group.symbol] = np.abs(np.interp(group.points[:, 0], x, y) - group.points[:, 1]).max()
    assert away["circle"] < 1.5
    assert away["ring"] > 3 * away["circle"]


def test_cuts_are_drawn_to_scale(analyses: dict[int, Analysis]) -> None:
    outcome = study_outcome(analyses[2])
    assert outcome is not None
    drawing = cut_figure(("Before", "After"), {"10 mm": (outcome.before, outcome.after)})
    wanted, tool, *_ = (s for s in drawing.shapes if isinstance(s, Line) and len(s.points) > 50)
    size = np.ptp(wanted.points, axis=0)
    assert size[1] / size[0] == pytest.approx(45 / 28, rel=0.01)
    per_m = size[0] / 0.028
    from_wanted = np.array([np.hypot(*(wanted.points - p).T).min() for p in tool.points])
    assert from_wanted.max() / per_m == pytest.approx(outcome.before_m, rel=0.1)
    bar = next(s for s in drawing.shapes if isinstance(s, Line) and s.width == 0.7)
    assert np.ptp(bar.points[:, 0]) / per_m == pytest.approx(0.010, rel=0.01)


def test_every_corner_zone_has_the_path_errors_of_the_app(analyses: dict[int, Analysis]) -> None:
    outcome = study_outcome(analyses[2])
    assert outcome is not None
    blocks = cut_blocks(outcome, "", iter(["Figure 1."]))
    (figure,) = (block for block in blocks if isinstance(block, Figure))
    texts = [shape.text for shape in figure.drawings[0].shapes if isinstance(shape, Text)]
    for zone in ZONES_M:
        path = rectangle(zone_m=zone, centre_m=CUTTING_POINT_M)
        after = predicted_cut(outcome.robot, path, friction=outcome.robot.friction).after
        assert millimetres(after.max_contour_error_m) in texts


def test_names_in_a_legend_end_before_the_next_sign(analyses: dict[int, Analysis]) -> None:
    names = [s for s in element_figure(analyses[2], 0).shapes if isinstance(s, Text) and s.size == 7]
    nominal, identified = (
        next(s for s in names if s.text == f"{which} model") for which in ("nominal", "identified")
    )
    if nominal.y == identified.y:
        assert identified.x - 16 > nominal.x + 0.57 * 7 * len(nominal.text) + 3


def test_svg_writes_every_shape() -> None:
    shapes = (
        Line(np.array([[0.0, 0.0], [10.0, 5.5]]), "#123456", dash=(4, 2), opacity=0.5),
        Marks(np.array([[3.0, 4.0]]), "#000000", "square"),
        Text(1, 2, "a < b & c", turned=True, anchor="middle", bold=True),
    )
    svg = to_svg(Drawing(20, 10, shapes, 'A "drawing"'))
    assert 'd="M0 0L10 5.5"' in svg
    assert 'stroke-dasharray="4 2"' in svg
    assert "a &lt; b &amp; c" in svg
    assert "rotate(-90 1 2)" in svg
    outline(svg)
