"""Tables and figures of records, phasors and the transfer matrix."""

from collections.abc import Iterable, Sequence
from functools import cache, partial
from typing import Any

import numpy as np
import streamlit as st

from jointid import Analysis, JointIdError, MotionRecord, Phasors, SineRecord, TransferMatrix
from jointid.arrays import Floats
from jointid.figures import VIEWS, coherences, element_response, single_record, spectra, waveforms
from jointid.phasors.distortion import distortion
from jointid.phasors.sine_fit import fit_sines
from jointid.records import JointRecord
from jointid.ui.shared.charts import NO_POSE, Table, choose_segment, show_tabs, table
from jointid.ui.shared.messages import show_error, show_info, show_text_table
from jointid.ui.shared.page import Page
from jointid.ui.study.overview import freed_note
from jointid.wording import plain, significant, unbroken, with_error

_ROUNDING_S = 1e-9
"""Below a nanosecond, uneven time steps are rounding of the times."""
HARMONICS = (
    "Odd harmonics show friction, a hardening gear or backlash; their phases separate friction from "
    "the gear. Even ones show friction that depends on the direction, or gravity or another one-sided "
    "load on a gear with backlash."
)


def show_quality(page: Page) -> None:
    """Show the quality of every record, and explain its figures."""
    st.header("Quality of every record", anchor=False)
    if page.study.motion_records:
        show_text_table(motion_table(page.study.motion_records))
        order = " of each joint in turn" if page.study.inertia.n > 1 else ""
        st.caption(
            f"Position range, peak to peak, and torque RMS about the mean{order}. Band: the frequencies "
            "that the analysis uses."
        )
    if not page.study.sine_records:
        return
    st.caption("Signal/noise and distortion: position and torque of the joint with the largest motion.")
    try:
        columns = quality_table(page.study.sine_records, page.sine_phasors())
        table(columns, phone=[*columns][:3])
    except JointIdError as error:
        show_error(error)
    with st.expander("What the columns mean"):
        st.markdown(
            "- **Signal/noise**: amplitude of the sine over its own standard error.\n"
            "- **Distortion**: amplitude of the harmonics over that of the sine, "
            "from friction or a nonlinear gear.\n"
            "- **Settling**: relative difference of the sine between the first quarter "
            "and the second half. Findings name the records that have not settled.\n"
            "- **Found**, shown where it differs from the stated frequency: that of the motion.\n"
            "- **Jitter**, shown if not zero: largest deviation of a sample time from a uniform grid."
        )


def quality_table(records: Sequence[SineRecord], phasors: Phasors) -> Table:
    """One row per record: quality of the joint that moves most, and of the clock."""
    n = phasors.n
    rows, mover = np.arange(len(records)), np.argmax(np.abs(phasors.q), axis=1)

    def both(values: Floats) -> list[str]:
        pairs = zip(values[rows, mover], values[rows, n + mover], strict=True)
        return [f"{_figure(angle)}, {_figure(torque)}" for angle, torque in pairs]

    stated, found = [r.frequency_hz for r in records], phasors.frequency_found_hz
    jitter = [_figure(1e3 * r.jitter_s) if r.jitter_s > _ROUNDING_S else "0" for r in records]
    return {
        "Record": [r.label or f"record {i}" for i, r in enumerate(records, start=1)],
        "Signal/noise": both(phasors.signal_to_noise),
        "Distortion (%)": both(100 * phasors.total_harmonic_distortion),
        "Settling (%)": [_figure(100 * x) for x in phasors.settling[rows, mover]],
        "Frequency (Hz)": _hertz(stated),
        **({} if np.allclose(found, stated, 1e-4) else {"Found (Hz)": [f"{f:.6g}" for f in found]}),
        "Periods": [round(r.periods, 1) for r in records],
        "Samples": [r.samples for r in records],
        **({"Jitter (ms)": jitter} if set(jitter) != {"0"} else {}),
    }


def show_distortion(record: JointRecord) -> None:
    """Show nonlinear distortion against noise, of a repeated multisine on odd lines."""
    try:
        found = distortion(record)
    except JointIdError:
        return  # another motion
    n = record.n
    names = [f"θ{j + 1}" for j in range(n)] + [f"τ{j + 1}" for j in range(n)]
    st.markdown("**Distortion against noise**")
    levels = (("Even lines (%)", found.even), ("Odd lines (%)", found.odd), ("Noise (%)", found.noise))
    show_text_table({"": names} | {name: [_figure(100 * x) for x in level] for name, level in levels})
    st.caption(
        f"A multisine on odd lines, period {found.period_s:.4g} s. Amplitude of lines without "
        "excitation over that of excited ones. Odd lines above the noise show friction, a hardening "
        "gear or backlash; even ones show friction that depends on the direction, or a one-sided load."
    )


def motion_table(records: Sequence[MotionRecord]) -> Table:
    """One row per record of any motion: length, band, and the motion of joints 1 ... n."""
    columns: dict[str, list[object]] = {
        "Record": [r.label or f"motion {i}" for i, r in enumerate(records, start=1)],
        "Length (s)": [_figure(r.samples * r.interval_s) for r in records],
        "Samples": [r.samples for r in records],
        "Band": [r.excitation.removesuffix(" band") for r in records],
    }
    every = {
        "Position range (rad)": [np.ptp(r.theta_rad[r.start :], axis=0) for r in records],
        "Torque RMS (N·m)": [np.std(r.tau_Nm[r.start :], axis=0) for r in records],
    }
    columns |= {
        name: [", ".join(map(_figure, row.tolist())) for row in rows] for name, rows in every.items()
    }
    uneven = [r.jitter_s if r.jitter_s > _ROUNDING_S else 0.0 for r in records]
    return columns | {"Jitter (ms)": [_figure(1e3 * x) if x else "0" for x in uneven]}


def phasor_table(phasors: Phasors, joint: int) -> Table:
    """One row per record: amplitude and phase of one joint's position and torque, with ± one error."""
    n = phasors.n
    z, error = phasors.z, phasors.standard_deviation / np.sqrt(2)  # half of the variance lies along z
    columns: dict[str, list[str]] = {
        "Record": list(phasors.labels),
        "Frequency (Hz)": _hertz(phasors.omega / (2 * np.pi)),
    }
    # In mrad an angle and its error have fewer zeros, so that a narrow column holds both.
    for k, name, unit, times in (
        (joint, f"θ{joint + 1}", "mrad", 1e3),
        (n + joint, f"τ{joint + 1}", "N·m", 1.0),
    ):
        size = np.abs(z[:, k])
        columns[f"|{name}| ({unit})"] = [
            with_error(times * a, times * e) for a, e in zip(size, error[:, k], strict=True)
        ]
        columns[f"∠{name} (°)"] = _angles(size, np.angle(z[:, k]), error[:, k])
    return columns


def _angles(size: Floats, angle: Floats, error: Floats) -> list[str]:
    """Phases in degrees with ± one error, "–" where the amplitude is within its noise."""
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.degrees(np.where(size > 0, error / size, np.inf))
    pairs = zip(np.degrees(angle), turn, strict=True)
    return ["–" if e >= 60 else with_error(a, e) for a, e in pairs]


def _hertz(frequencies: Iterable[float]) -> list[str]:
    """Format frequencies with five digits at most, all to the same decimal place."""
    rounded = [float(f"{f:.5g}") for f in frequencies]
    places = max((len(plain(f).partition(".")[2]) for f in rounded), default=0)
    return [f"{f:.{places}f}" for f in rounded]


def _figure(value: float) -> str:
    return "–" if np.isnan(value) else significant(float(value), 2)


def choose_pose(poses: list[str]) -> str:
    """Ask for the pose when there are several."""
    if len(poses) == 1:
        return poses[0]
    return st.selectbox(
        "Pose",
        poses,
        format_func=lambda pose: pose or NO_POSE,
        key="pose",
        bind="query-params",
        help="K and D do not depend on the pose; the arm's inertia, and so H, does.",
    )


def choose_element(n: int) -> tuple[int, int]:
    """Ask which element of H to look at: the diagonal ones, then one of each symmetric pair."""
    if n == 1:
        return 0, 0
    pairs = [(j, j) for j in range(n)] + [(i, j) for i in range(n) for j in range(i + 1, n)]
    names = [f"H{i + 1}{j + 1}" + ("" if i == j else f" and H{j + 1}{i + 1}") for i, j in pairs]
    shown = choose_segment(
        "Element",
        names,
        "element",
        hint="$H_{ij}$ is the acceleration of motor i over the torque of motor j. "
        "Diagonal elements are the response to a motor's own torque.",
    )
    return pairs[names.index(shown)]


def show_element(page: Page, analysis: Analysis, pose: str, i: int, j: int) -> None:
    """Show H_ij over frequency; a diagonal element beside the single-record responses of its joint."""
    n, name = page.study.inertia.n, f"H{i + 1}{j + 1}"
    view = choose_segment("View", VIEWS, "view")
    drawn: dict[str, Any] = {"pose": pose, "view": view}
    what = f"{name} over frequency, measured and modelled"
    draw = partial(element_response, analysis, i, j, **drawn)
    if i == j and n > 1 and page.study.of_pose(pose).any():
        left, right = st.columns(2)
        with left:
            st.markdown("**One record alone** (Figure 3 of the paper)")
            page.show(
                f"alone {i} {pose} {view}",
                partial(single_record, analysis, i, **drawn),
                f"Acceleration over torque of joint {i + 1} from single records, over frequency",
            )
        with right:
            of_paper = f" (Figure {4 + i} of the paper)" if i < 2 else ""
            st.markdown(f"**All records together**{of_paper}")
            page.show(f"H {i} {j} {pose} {view}", draw, what)
        caption = "A peak that only single records show comes from the other joints' controllers."
    else:
        page.show(f"H {i} {j} {pose} {view}", draw, what)
        caption = "Measured points with ± one standard error."
        if i != j:
            caption = f"{name} and H{j + 1}{i + 1} are equal, because M2 is symmetric."
    st.caption(caption + freed_note(analysis))


def show_how_well_known(matrix: TransferMatrix, i: int, j: int) -> None:
    """Condition and reciprocity over frequency, rejected frequencies, and H_ij as numbers."""
    if matrix.H.shape[1] > 1:
        st.header("How well H is known", anchor=False)
        st.write(
            "With a condition number of 1 the torques of the records are orthogonal; at 100 their "
            "noise is amplified about a hundredfold. The reciprocity error is the largest difference "
            "between $H_{ij}$ and $H_{ji}$, relative to the diagonal."
        )
    if matrix.rejected:
        show_info(unbroken("\n".join(matrix.rejected)))
    columns = element_table(matrix, i, j)
    names = [*columns]
    table(columns, phone=[*names[:2], "Condition" if "Condition" in columns else names[2]])
    st.caption("The chosen element as measured, with ± one standard error. |H| in 1/(kg·m²).")


def element_table(matrix: TransferMatrix, i: int, j: int) -> Table:
    """One row per frequency: magnitude of H_ij, and H_ji, with standard error; phase; condition."""
    n = matrix.H.shape[1]
    columns: dict[str, list[str]] = {"Frequency (Hz)": _hertz(matrix.omega / (2 * np.pi))}
    error = matrix.standard_deviation / np.sqrt(2)
    for row, column in dict.fromkeys([(i, j), (j, i)]):
        size, angle = (f(matrix.H[:, row, column]) for f in (np.abs, np.angle))
        name, noise = f"H{row + 1}{column + 1}", error[:, row, column]
        columns[f"|{name}|"] = [with_error(a, e) for a, e in zip(size, noise, strict=True)]
        columns[f"∠{name} (°)"] = _angles(size, angle, noise)
    if n > 1:
        columns["Condition"] = [significant(c, 3) for c in matrix.condition]
        columns["Reciprocity (%)"] = [significant(100 * e, 2) for e in matrix.reciprocity_error]
    return columns


def show_record(page: Page, number: int) -> None:
    """Show a record, counted from 0, in tabs."""
    record = page.study.records[number]
    is_sine = isinstance(record, SineRecord)

    @cache
    def fitted() -> Floats | None:
        if not isinstance(record, SineRecord):
            return None
        (sine,) = fit_sines([record])  # here: it takes a tenth of the time of the drawing
        return sine.at(record.time_s, record.omega)

    def show_waveforms(periods: float | None) -> None:
        page.show_per_joint(
            f"waveforms {number} {periods}",
            lambda j, dark: waveforms(record, j, fitted(), periods=periods, dark=dark),
            "Position and torque of joint {0} over time" + (" with the fitted sine" if is_sine else ""),
        )

    def show_spectra() -> None:
        what = "Spectra of position and torque of joint {0}"
        page.show_per_joint(f"spectra {number}", partial(spectra, record), what)
        if is_sine:
            st.caption(HARMONICS)

    def show_coherence() -> None:
        page.show_per_joint(
            f"coherence {number}",
            partial(coherences, record),
            "Coherence of the motion of joint {0} with the torques, over frequency",
        )
        st.caption(
            "Coherence: share of the motor's motion that is linear in the torques of all motors. In "
            "closed loop the torque also follows encoder noise, so only frequencies where the position "
            "exceeds its noise floor count."
        )
        show_distortion(record)

    views = {
        "A few periods" if is_sine else "Two seconds": lambda: show_waveforms(4.0 if is_sine else 2.0),
        "Whole record": lambda: show_waveforms(None),
        "Spectrum": show_spectra,
    }
    show_tabs("records_view", views if is_sine else views | {"Coherence": show_coherence})
