"""Figures show the values, units and uncertainty of results, one colour per meaning."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import compress
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest
from plotly.io import to_json

from jointid import Analysis, Friction, Inertia, JointIdError, SineRecord, Study, analyse, motor_response
from jointid.answer import StiffnessUnit, gear_terms
from jointid.figures import (
    dynamic_stiffness,
    element_response,
    model_over_measurement,
    phasor_plane,
    raw_columns,
    single_record,
    spectra,
    torsion_curve,
    waveforms,
)
from jointid.figures.response_curves import in_legend
from jointid.figures.style import DARK, LIGHT, frequency_axis, log_axis, plain_text
from jointid.figures.waveforms import downsampled
from jointid.ui.study.data_quality import element_table, phasor_table
from jointid.verdict.evidence import problem


@pytest.fixture(scope="module")
def analyses(studies: dict[int, Study]) -> dict[int, Analysis]:
    return {n: analyse(study, method="weighted") for n, study in studies.items()}


def every_figure(analysis: Analysis, dark: bool) -> dict[str, go.Figure]:
    study, last = analysis.study, analysis.study.inertia.n - 1
    record = study.records[3]
    return {
        "waveforms": waveforms(record, last, dark=dark),
        "spectra": spectra(record, last, dark=dark),
        "phasors": phasor_plane(analysis.phasors, chosen=1, dark=dark),
        "torque phasors": phasor_plane(analysis.phasors, torque=True, dark=dark),
        "element": element_response(analysis, last, 0, dark=dark),
        "single": single_record(analysis, last, dark=dark),
        "small": model_over_measurement(analysis, last, dark=dark),
        "stiffness": dynamic_stiffness(analysis.fit, last, study.nominal, dark=dark),
    }


def trace(figure: go.Figure, name: str, which: int = 0) -> Any:
    found = [t for t in figure.data if t.name == name]
    assert found, [t.name for t in figure.data]
    return found[which]


def test_figures_are_written_as_plotly_writes_them(analyses: dict[int, Analysis]) -> None:
    for name, figure in every_figure(analyses[2], dark=False).items():
        assert to_json(figure) == to_json(go.Figure.to_dict(figure), validate=False), name


@pytest.mark.parametrize("joints", [1, 2, 3])
@pytest.mark.parametrize("dark", [False, True])
def test_every_figure_names_its_axes_with_units_and_its_meanings_once(
    analyses: dict[int, Analysis], joints: int, dark: bool
) -> None:
    for name, figure in every_figure(analyses[joints], dark).items():
        layout = figure.to_dict()["layout"]
        axes = [axis for key, axis in layout.items() if key.startswith(("xaxis", "yaxis"))]
        for axis in axes:
            text = axis["title"]["text"]
            assert "(" in text, (name, text)
        legend = [t.name for t in figure.data if t.showlegend is not False]
        assert len(legend) == len(set(legend)), (name, legend)
        ink = DARK if dark else LIGHT
        for t in figure.data:
            colour = t.marker.color if "markers" in t.mode else t.line.color
            assert colour in (ink.measured, ink.nominal, ink.identified, ink.quiet), name
            if t.name.startswith("nominal"):
                assert colour == ink.nominal
            if t.name.startswith(("identified", "fitted")):
                assert colour == ink.identified


def test_measured_points_and_model_of_h_are_those_of_the_analysis(analyses: dict[int, Analysis]) -> None:
    analysis = analyses[2]
    figure = element_response(analysis, 1, 1)
    matrix = analysis.transfer_matrices[""]
    points = trace(figure, "measured H₂₂")
    np.testing.assert_allclose(points.y, np.abs(matrix.H[:, 1, 1]))
    np.testing.assert_allclose(points.x, matrix.omega / (2 * np.pi))
    np.testing.assert_allclose(points.error_y.array, matrix.standard_deviation[:, 1, 1] / np.sqrt(2))
    model = trace(figure, "identified model")
    H = motor_response(2 * np.pi * model.x, analysis.study.inertia, analysis.fit.elasticity)
    np.testing.assert_allclose(model.y, np.abs(H[:, 1, 1]))
    phase = trace(figure, "identified model", 1)
    np.testing.assert_allclose(np.exp(1j * np.radians(phase.y)), np.exp(1j * np.angle(H[:, 1, 1])))


def test_decibels_are_those_of_the_magnitude(analyses: dict[int, Analysis]) -> None:
    matrix = analyses[2].transfer_matrices[""]
    H, error = matrix.H[:, 0, 0], matrix.standard_deviation[:, 0, 0] / np.sqrt(2)
    points = trace(element_response(analyses[2], 0, 0, view="In dB"), "measured H₁₁")
    np.testing.assert_allclose(points.y, 20 * np.log10(np.abs(H)))
    np.testing.assert_allclose(points.error_y.array, 20 * np.log10(1 + error / np.abs(H)))


def test_nyquist_draws_real_and_imaginary_part_to_one_scale(analyses: dict[int, Analysis]) -> None:
    figure = element_response(analyses[2], 0, 1, view="Nyquist")
    matrix = analyses[2].transfer_matrices[""]
    points = trace(figure, "measured H₁₂")
    np.testing.assert_allclose(points.x + 1j * points.y, matrix.H[:, 0, 1])
    np.testing.assert_allclose(points.customdata, matrix.omega / (2 * np.pi))
    np.testing.assert_array_equal(points.error_x.array, points.error_y.array)
    assert figure.layout.yaxis.scaleanchor == "x"


@pytest.mark.parametrize(("i", "j"), [(0, 0), (1, 1), (0, 1)])
def test_phases_stay_on_the_branch_of_the_model(analyses: dict[int, Analysis], i: int, j: int) -> None:
    figure = element_response(analyses[2], i, j)
    model = [t for t in figure.data if t.name == "identified model"][1]
    measured = [t for t in figure.data if t.name.startswith("measured")]
    assert np.abs(np.diff(model.y)).max() < 90
    for points in (t for t in measured if t.yaxis == "y2"):
        near = np.interp(np.log(points.x), np.log(model.x), model.y)
        assert np.abs(points.y - near).max() < 30


def test_an_off_diagonal_element_comes_with_its_mirror_image(analyses: dict[int, Analysis]) -> None:
    figure = element_response(analyses[2], 0, 1)
    one, other = trace(figure, "measured H₁₂"), trace(figure, "measured H₂₁")
    assert one.marker.symbol != other.marker.symbol
    np.testing.assert_allclose(one.y, other.y, rtol=0.05)


def test_with_friction_compensated_and_raw_measurements_are_drawn(
    analyses: dict[int, Analysis],
) -> None:
    plain = analyses[2]
    raw = plain.transfer_matrices[""]
    found = replace(
        plain,
        fit=replace(plain.fit, friction=Friction(np.ones(2), np.zeros(2), np.zeros(4))),
        compensated_transfer_matrices={"": replace(raw, H=1.1 * raw.H)},
    )
    figure = element_response(found, 0, 0)
    full, hollow = trace(figure, "without friction"), trace(figure, "as measured")
    np.testing.assert_allclose(full.y, 1.1 * hollow.y)
    np.testing.assert_allclose(hollow.y, np.abs(raw.H[:, 0, 0]))
    assert (full.marker.symbol, hollow.marker.symbol) == ("circle", "circle-open")
    np.testing.assert_allclose(
        trace(model_over_measurement(found, 0), "measured, without friction").y, full.y
    )
    assert not any("without" in t.name for t in element_response(plain, 0, 0).data)
    unusable = replace(found, findings=(problem("The torques look swapped", "", "", 1.0),))
    assert not any("without" in t.name for t in element_response(unusable, 0, 0).data)


def test_single_records_show_every_record_once_on_the_scale_of_h(analyses: dict[int, Analysis]) -> None:
    analysis = analyses[2]
    figure = single_record(analysis, 0)
    phasors = analysis.phasors
    shown = np.concatenate([t.y for t in figure.data if t.name.startswith("record") and t.yaxis != "y2"])
    expected = np.abs(-(phasors.omega**2) * phasors.q[:, 0] / phasors.tau[:, 0])
    np.testing.assert_allclose(np.sort(shown), np.sort(expected))
    assert figure.layout.yaxis.range == element_response(analysis, 0, 0).layout.yaxis.range


def test_dynamic_stiffness_is_flat_at_k_and_rises_with_omega_d(analyses: dict[int, Analysis]) -> None:
    fit = analyses[2].fit
    figure = dynamic_stiffness(fit, 0)
    flat, rising = trace(figure, "identified"), trace(figure, "identified", 1)
    np.testing.assert_allclose(flat.y, fit.K[0])
    np.testing.assert_allclose(rising.y, 2 * np.pi * rising.x * fit.D[0])
    points = trace(figure, "each record")
    pull = (points.y - fit.K[0]) / points.error_y.array
    # Two numbers of twelve records are fitted; the bars must be those of the scatter.
    assert 0.3 < np.sqrt(np.mean(pull**2)) < 2.5


def test_ticks_follow_the_common_style() -> None:
    axis = frequency_axis(np.array([3.0, 30.0]))
    low, high = 10 ** np.array(axis["range"])
    shown = [low <= value <= high for value in axis["tickvals"]]
    assert [*compress(axis["ticktext"], shown)] == ["3", "5", "10", "20", "30"]
    assert axis["type"] == "log"


def test_a_number_has_the_same_text_on_short_and_long_axes() -> None:
    axes = [log_axis("", range=[low, high]) for low, high in ((3.0, 4.5), (1.0, 4.0), (-5.0, 7.0))]
    texts = [dict(zip(axis["tickvals"], axis["ticktext"], strict=True)) for axis in axes]
    for text in texts:
        assert {text[value] for value in text if value == 1e4} <= {"10000"}
    assert [*texts[2].values()] == ["10⁻⁵", "0.001", "0.1", "10", "1000", "10⁵", "10⁷"]
    assert texts[0][2e5] == "2×10⁵"


def test_phase_ticks_are_every_90_degrees(analyses: dict[int, Analysis]) -> None:
    axis = element_response(analyses[2], 0, 0).layout.yaxis2
    assert (axis.dtick, axis.tick0) == (90, 0)


def test_waveforms_show_the_samples_and_the_fitted_sine(studies: dict[int, Study]) -> None:
    record = studies[2].records[0]
    fitted = np.column_stack([record.theta_rad, record.tau_Nm]) + 1.0
    figure = waveforms(record, 1, fitted, periods=2.0)
    last = int(np.searchsorted(record.time_s, 2 / record.frequency_hz)) + 1
    for logged, sine, signal in zip(
        [t for t in figure.data if t.name == "logged"],
        [t for t in figure.data if t.name == "fitted sine"],
        (record.theta_rad[:, 1], record.tau_Nm[:, 1]),
        strict=True,
    ):
        np.testing.assert_array_equal(logged.y, signal[:last])
        np.testing.assert_array_equal(sine.y, signal[:last] + 1.0)


def test_rows_that_are_not_used_are_marked() -> None:
    time = np.arange(2000) / 500.0
    record = SineRecord(2.0, time, np.sin(12.566 * time), np.sin(12.566 * time), start_s=1.5)
    shapes = waveforms(record, 0).layout.shapes
    assert [(s.x0, s.x1) for s in shapes] == [(0.0, 1.5)]
    assert not waveforms(record, 0, periods=3).layout.shapes
    assert waveforms(record, 0, periods=3).data[0].x[0] == 1.5


def test_the_spectrum_peaks_at_the_marked_excitation(studies: dict[int, Study]) -> None:
    record = studies[2].records[4]
    figure = spectra(record, 0)
    peak = figure.data[0].x[np.argmax(figure.data[0].y)]
    assert peak == pytest.approx(record.frequency_hz, rel=0.1)
    assert figure.layout.shapes[0].x0 == record.frequency_hz
    legend = {t.name: t for t in figure.data if t.showlegend is not False}
    assert set(legend) == {"excitation", "harmonics 2, 3, 5, 7"}
    for shape, t in zip(figure.layout.shapes, legend.values(), strict=False):
        assert (shape.line.color, shape.line.dash) == (t.line.color, t.line.dash)


@pytest.mark.parametrize("periods", [4.0, None])
def test_samples_are_drawn_above_the_fit(studies: dict[int, Study], periods: float | None) -> None:
    record = studies[2].records[0]
    fitted = np.column_stack([record.theta_rad, record.tau_Nm])
    figure = waveforms(record, 0, fitted, periods=periods)
    sine, logged = trace(figure, "fitted sine"), trace(figure, "logged")
    assert sine.line.dash == "dash"
    thickness = logged.marker.size if "markers" in logged.mode else logged.line.width
    assert thickness > 2 * sine.line.width
    assert logged.opacity < 1


def test_the_chosen_joint_is_highlighted_among_many(analyses: dict[int, Analysis]) -> None:
    figure = phasor_plane(analyses[3].phasors, chosen=0, joint=1)
    assert trace(figure, "joint 2").marker.color == LIGHT.measured
    others = [t for t in figure.data if t.name == "other joints"]
    assert {t.marker.color for t in others} == {LIGHT.quiet}
    assert [t.showlegend for t in others] == [True, False]  # small grey signs are not told apart
    assert [t.name for t in figure.data].count("chosen record") == 1


def test_a_model_is_drawn_through_all_of_its_points(analyses: dict[int, Analysis]) -> None:
    """Simplified by plotly, it has visible corners."""
    assert trace(model_over_measurement(analyses[2], 0), "identified model").line.simplify is False


def test_a_legend_stays_short_enough_for_a_phone() -> None:
    assert in_legend("without friction and delay") == "without friction and delay"
    assert in_legend("without friction, backlash and gear hysteresis") == "without fitted effects"


def test_hover_texts_give_phasors_with_errors_in_rounded_digits(analyses: dict[int, Analysis]) -> None:
    phasors = analyses[2].phasors
    for t in phasor_plane(phasors).data:
        if t.customdata is not None:
            assert all("±" in text and "e-" not in text for _, text, _ in t.customdata)
    columns = phasor_table(phasors, 0)
    assert "|θ1| (mrad)" in columns
    cells = [str(cell) for name, column in columns.items() if name.startswith("|θ") for cell in column]
    assert all(float(cell.split("± ")[1].lstrip("<")) > 0 for cell in cells)
    assert float(cells[0].split(" ")[0]) == pytest.approx(1e3 * abs(phasors.q[0, 0]), rel=0.01)


def test_frequencies_of_a_table_end_at_one_place_and_phases_have_errors(
    analyses: dict[int, Analysis],
) -> None:
    (matrix,) = analyses[2].transfer_matrices.values()
    columns = element_table(matrix, 0, 0)
    hertz = columns["Frequency (Hz)"]
    np.testing.assert_allclose([float(f) for f in hertz], matrix.omega / (2 * np.pi), rtol=1e-4)
    assert len({len(str(f).partition(".")[2]) for f in hertz}) == 1
    assert not all(str(f).endswith("0") and "." in str(f) for f in hertz)
    assert all("±" in str(phase) for phase in columns["∠H11 (°)"])


def test_thinning_loses_no_spike() -> None:
    x = np.arange(1_000_003.0)
    y = np.sin(x / 1e4)
    y[[777_777, 123_456]] = 9.0, -9.0
    few_x, few_y = downsampled(x, y)
    assert few_y.size <= 2002
    assert (few_y.max(), few_y.min()) == (9.0, -9.0)
    assert few_x[np.argmax(few_y)] == 777_777
    assert np.all(np.diff(few_x) >= 0)


def test_raw_columns_are_drawn_for_tables_that_are_no_record() -> None:
    columns = {"t": np.arange(5.0), "a": np.array([1.0, np.nan, 3.0, 4.0, 5.0]), "b": np.zeros(5)}
    figure = raw_columns(columns)
    assert [t.name for t in figure.data] == ["a", "b"]
    alone = raw_columns({"only": np.arange(4.0)})
    np.testing.assert_array_equal(alone.data[0].x, np.arange(4.0))
    with pytest.raises(JointIdError, match="no column"):
        raw_columns({})


def test_the_titles_of_raw_columns_fit_beside_their_panels() -> None:
    names = ["Axis1.ActPos (deg)", "axis2_motor_position (deg)", "a"]
    figure = raw_columns({"t": np.arange(5.0)} | dict.fromkeys(names, np.zeros(5)))
    axes = [figure.layout[axis] for axis in ("yaxis", "yaxis2", "yaxis3")]
    for axis in axes:
        low, high = axis.domain
        assert figure.layout.height * (high - low) > 7 * len(axis.title.text)
    assert axes[0].title.text == names[0]
    assert axes[1].title.text == "axis2_motor_pos… (deg)"


@pytest.fixture(scope="module")
def no_spring(analyses: dict[int, Analysis]) -> Analysis:
    """The same records with inertias so wrong that K2 comes out negative."""
    analysis = analyses[2]
    right = analysis.study.inertia
    wrong = Inertia(0.5 * right.M, 2 * right.M2)
    study = Study(analysis.study.records[:6], wrong, nominal=analysis.study.nominal)
    return analyse(study, method="least-squares")


@pytest.mark.parametrize(
    "draw",
    [
        lambda a: element_response(a, 0, 0),
        lambda a: single_record(a, 0),
        lambda a: model_over_measurement(a, 0),
        lambda a: dynamic_stiffness(a.fit, 0, a.study.nominal),
    ],
)
def test_with_an_unphysical_estimate_the_measurement_is_still_drawn(
    no_spring: Analysis, draw: Callable[[Analysis], go.Figure]
) -> None:
    with pytest.raises(JointIdError):
        _ = no_spring.fit.elasticity
    figure = draw(no_spring)
    assert any("markers" in t.mode and len(t.x) for t in figure.data)
    assert not any(t.name == "identified model" for t in figure.data)


def test_every_figure_is_drawn_with_a_joint_at_rest(
    studies: dict[int, Study], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("jointid.analysis.findings", lambda _: ())  # no figure shows them
    study = studies[2]
    quiet = np.array([1.0, 0.0])
    records = [
        SineRecord(r.frequency_hz, r.time_s, r.theta_rad * quiet, r.tau_Nm * quiet)
        for r in study.records[:4]
    ]
    analysis = analyse(Study((*study.records[:4], *records), study.inertia), method="weighted")
    for figure in every_figure(analysis, dark=False).values():
        assert figure.data


def test_a_cell_without_a_number_leaves_a_gap() -> None:
    columns = {"time_s": np.array([0.0, 0.1, np.nan, 0.3]), "tau": np.array([1.0, np.nan, 3.0, 4.0])}
    figure = raw_columns(columns)
    assert np.isnan(figure.data[0].y[1])
    np.testing.assert_allclose(figure.data[0].x, [0.0, 0.1, 0.2, 0.3])


def test_a_text_from_a_file_is_shown_unchanged() -> None:
    """Plotly reads tags and entities; a paint of a style may even be fetched from another machine."""
    assert plain_text('<span style="fill:url(//x)">a</span> &lt;') == (
        '&lt;span style="fill:url(//x)"&gt;a&lt;/span&gt; &amp;lt;'
    )
    assert plain_text("a" * 330) == "a" * 79 + "…"
    figure = raw_columns({"<b>t</b>": np.arange(3.0), "<a href='//x'>y</a>": np.arange(3.0)})
    assert "<b>" not in figure.to_json()
    assert figure.layout.xaxis.title.text == "&lt;b&gt;t&lt;/b&gt;"
    assert figure.data[0].name == "&lt;a href='//x'&gt;y&lt;/a&gt;"


def test_torsion_curves_of_one_frequency_are_named_by_it(analyses: dict[int, Analysis]) -> None:
    """Neither "from" nor "to", which would be half a range."""
    fit = analyses[1].fit
    (curve,) = fit.torsion_curves
    fields = ("deflection_rad", "torque_Nm", "deflection_noise_rad", "torque_noise_Nm", "frequency_hz")
    alone = replace(curve, **{name: getattr(curve, name)[:1] for name in fields})
    alike = replace(curve, frequency_hz=np.full_like(curve.frequency_hz, curve.frequency_hz[0]))
    for each in (alone, alike):
        drawn = torsion_curve(replace(fit, torsion_curves=(each,)), 0).data
        shown = [trace.name for trace in drawn if trace.showlegend is not False]
        assert shown == [f"{curve.frequency_hz[0]:.3g} Hz", "fitted law"]


def test_a_gear_is_drawn_at_the_joint_in_its_unit(analyses: dict[int, Analysis]) -> None:
    """With N = 100 the deflection is a hundredth, the torque a hundredfold, and K ten thousandfold."""
    fit, unit = analyses[2].fit, StiffnessUnit.named("N·m/arcmin at the joint", np.array([100.0, -50]))
    arcmin = np.pi / 10800
    for j, ratio in enumerate((100.0, 50.0)):
        motor, joint = torsion_curve(fit, j).data[-1], torsion_curve(fit, j, unit=unit).data[-1]
        np.testing.assert_allclose(joint.x, np.array(motor.x) * 1e-3 / arcmin / ratio)
        np.testing.assert_allclose(joint.y, ratio * np.array(motor.y))
        K = gear_terms(fit, j, unit)["K (tangent stiffness)"]
        assert float(K.split(" ± ")[0]) == pytest.approx(fit.K[j] * ratio**2 * arcmin, rel=1e-2)
        assert K.endswith("N·m/arcmin")
        level = dynamic_stiffness(fit, j, unit=unit)
        assert level.data[0].y[0] == pytest.approx(fit.K[j] * ratio**2 * arcmin)
        assert "N·m/arcmin" in level.layout.yaxis.title.text
