"""Figures of the page Elasticity, and the checks of its model."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any, get_args

import numpy as np
import streamlit as st

from jointid import Analysis, JointIdError
from jointid.analysis import NOT_USABLE
from jointid.answer import gear_terms, without_curve
from jointid.estimation.elasticity import ElasticityFit
from jointid.exporting import torsion_table
from jointid.figures import (
    dynamic_stiffness,
    element_response,
    stiffness_over_amplitude,
    torsion_curve,
)
from jointid.figures.response_curves import removed_effects
from jointid.figures.stiffness import ColourBy, drawn_records
from jointid.figures.uncertainty import left_out_prediction, normalised_residuals
from jointid.ui.shared.charts import NO_POSE, choose_joint, choose_segment, download, table
from jointid.ui.shared.messages import show_info, show_note, show_text_table
from jointid.ui.shared.page import Page
from jointid.ui.study.data_quality import HARMONICS
from jointid.ui.study.overview import freed_note
from jointid.uncertainty.poses import fits_by_pose
from jointid.uncertainty.validation import (
    HarmonicContent,
    TorquePrediction,
    harmonic_content,
    predict_torques,
    record_residuals,
    second_amplitude,
)
from jointid.verdict.rules_model import EXPLAINED
from jointid.wording import file_stem, significant, with_error

_SIGNIFICANT = 4.0
"""Root mean square of a record's harmonics, in units of their noise, that is not by chance."""
_SPREAD = 1.5
"""Largest over smallest torque amplitude from which K over amplitude is worth a plot."""
_DYNAMIC_STIFFNESS = r"""
$(K_j + i\omega D_j)\,a_j = b_j$ (8) with
$\mathbf a = (\mathbf I + \mathbf M_2^{-1}\mathbf M)s^2\mathbf q - \mathbf M_2^{-1}\boldsymbol\tau$ (9)
and $\mathbf b = s^2\boldsymbol\tau - \mathbf M s^4\mathbf q$ (11).
The real part of b/a is K at every frequency, the imaginary part ωD; bars are ± one standard error.
Deviations at only some frequencies indicate friction, a torque delay or wrong inertias.
"""
_REMOVED = (
    "The points are {removed}, as identified. For a nonlinear gear, they show the linear part only; "
    "K over amplitude shows the whole gear."
)


def figures(page: Page, analysis: Analysis) -> dict[str, Callable[[], object]]:
    """Return the figures that a study allows by their names, the torsion curves first."""
    fit, unit = analysis.fit, analysis.unit
    pose = next(iter(analysis.transfer_matrices), "")
    poses = [record.pose or "" for record in analysis.study.records]

    def per_joint(what: str, draw: Callable[..., Any], caption: str) -> Callable[[], object]:
        return lambda: page.show_per_joint(f"{what} {pose}", draw, what, caption=caption)

    found: dict[str, Callable[[], object]] = {"Torsion curve": lambda: _show_torsion(page, analysis)}
    if analysis.transfer_matrices:
        found["Frequency response"] = per_joint(
            "H{0}{0} over frequency, measured and modelled",
            lambda j, dark: element_response(analysis, j, j, pose=pose, dark=dark),
            "Acceleration of each motor over its torque, without the effect of the controllers."
            + freed_note(analysis),
        )
    if page.study.motion_records:  # the other figures look at every sine separately
        return found
    removed = removed_effects(analysis)
    found["Dynamic stiffness"] = per_joint(
        "Dynamic stiffness of joint {0}",
        partial(dynamic_stiffness, fit, nominal=page.study.nominal, unit=unit),
        _DYNAMIC_STIFFNESS + (removed and _REMOVED.format(removed=removed)),
    )
    if all(a.max() > _SPREAD * a.min() for a in (curve.amplitude_Nm for curve in fit.torsion_curves)):
        found["K over amplitude"] = per_joint(
            "Stiffness of joint {0} over the torque amplitude of the records",
            partial(stiffness_over_amplitude, fit, poses=poses, unit=unit),
            "Real part of the dynamic stiffness of each record (torque divided by deflection, "
            "fundamental only) versus torque amplitude, with the fitted law. A linear gear gives a "
            "horizontal line at K; hardening raises it at large torque, hysteresis raises it at "
            "small torque, and backlash lowers it at small torque.",
        )
    return found


def _show_torsion(page: Page, analysis: Analysis) -> None:
    sines, motions = page.study.sine_records, page.study.motion_records
    st.caption(
        "Torque through the gear over its deflection, from motor data alone. The blue line is the "
        "fitted elastic law; its slope at zero torque, outside any backlash, is K, the tangent "
        "stiffness."
        + " Damping and hysteresis open the loops, one per record, drawn with ± two standard errors."
        * bool(sines)
        + f" Motions appear as dots{', coloured by torque amplitude' * (not sines)}." * bool(motions)
        + _left_out(analysis)
    )
    if missing := without_curve(analysis.fit):
        show_info(missing)
    by: ColourBy = "amplitude"
    if sines:  # a motion has no frequency
        by = choose_segment("Colour records by", get_args(ColourBy), "torsion_colour")
    joints = page.show_per_joint(
        f"torsion {by}",
        partial(torsion_curve, analysis.fit, colour_by=by, unit=analysis.unit),
        "Torsion curve of joint {0}, torque over deflection with the fitted law",
    )
    if analysis.state != NOT_USABLE:
        _show_gear_terms(analysis, joints)
        if advice := second_amplitude(analysis.fit):
            show_info(f"{advice} The tab Your own plan of the page Plan has this record.")
    download(
        "Torsion curves (.csv)",
        lambda: torsion_table(analysis),
        f"{file_stem(page.study.name)}_torsion.csv",
        hint="Torque u = τ − Mθ̈ − friction over deflection θ − θₐ, with M₂θ̈ₐ = u. It includes damping "
        "and hysteresis; the elastic law does not. The mean deflection of a record is not observable "
        "and is set to 0.",
    )


def _left_out(analysis: Analysis) -> str:
    """Say which records the torsion curves do not show."""
    amplitudes = [curve.amplitude_Nm for curve in analysis.fit.torsion_curves]
    most, text = max(amplitudes, key=len), ""
    if (drawn := len(drawn_records(most))) < most.size:
        text = f" Of {most.size} records {drawn} are drawn, spread over their torque amplitudes."
    if min(map(len, amplitudes)) < most.size:
        text += " A motion without frequencies above the locked resonance has no dots."
    return text


def _show_gear_terms(analysis: Analysis, joints: Sequence[int]) -> None:
    # One row for all joints, whose largest torques differ and have a row of their own.
    each = [
        {
            f"{name.partition(' at ')[0]} at the largest torque" if " at " in name else name: text
            for name, text in gear_terms(analysis.fit, j, analysis.unit).items()
        }
        for j in joints
    ]
    names = dict.fromkeys(name for terms in each for name in terms)
    show_text_table(
        {"Gear": list(names)}
        | {
            f"Joint {j + 1}": [terms.get(name, "–") for name in names]
            for j, terms in zip(joints, each, strict=True)
        }
    )


@st.cache_resource(max_entries=240, show_spinner=False)
def _predicted(digest: str, method: str, _fit: ElasticityFit) -> TorquePrediction:
    """Predict in this process: it takes milliseconds, and a worker may be busy for a second."""
    return predict_torques(_fit)


def show_prediction(page: Page, analysis: Analysis) -> None:
    """Prediction of the records left out of the fit, or the reason for its absence."""
    if analysis.state == NOT_USABLE:
        return
    try:
        prediction = _predicted(page.digest, page.method, analysis.fit)
    except JointIdError as error:
        show_note(f"No prediction of records left out of the fit. {error}")
        return
    apart = significant(100 * float(np.median(prediction.relative_error)), 2)
    # Judged as the verdict judges the misfit of all records.
    times, limit = (significant(float(np.sqrt(x)), 2) for x in (prediction.misfit, EXPLAINED))
    doubt = " The model lacks an effect, or half of the frequencies do not determine all its parameters."
    show_note(
        "Cross-check: K and D from half of the frequencies predict the gear torques at the others "
        f"to {apart} % (median), {times} × the noise; up to {limit} × counts as agreement."
        + doubt
        * (prediction.misfit > EXPLAINED)
    )


def show_model_holds(page: Page, analysis: Analysis) -> None:
    """Prediction, residuals and harmonics; amplitudes when a study has several."""
    st.markdown("**Prediction of records left out of the fit**")
    st.caption(
        "Torques through the gears, predicted with K and D from the other half of the frequencies, "
        "minus the measured ones."
    )
    try:
        prediction = _predicted(page.digest, page.method, analysis.fit)
    except JointIdError as error:
        show_info(error)
    else:
        what = "Relative difference of measured and predicted torques over frequency"
        page.show("left_out", partial(left_out_prediction, prediction), what)

    st.markdown("**Residual of each record**")
    residuals = record_residuals(analysis.phasors, analysis.fit)
    record, joint = residuals.worst
    show_note(
        "Residual torque over its noise: about 1 when the model holds, seldom above 3. "
        f"Largest: {residuals.labels[record]}, joint {joint + 1}."
    )
    page.show(
        "residuals", partial(normalised_residuals, residuals), "Normalised residual of every record"
    )
    _show_harmonics(analysis)


def _show_harmonics(analysis: Analysis) -> None:
    try:
        content = harmonic_content(analysis.phasors)
    except JointIdError as error:
        show_info(error)
        return
    st.markdown("**Harmonics of the torques**")
    st.caption(
        "Relative to the fundamental; –: within the noise. A linear gear without friction causes none. "
        + HARMONICS
    )
    joints: Sequence[int] = range(analysis.fit.n)
    if len(joints) > 1:
        joints = [choose_joint(joints, "details_joint")]
    table({"Record": list(analysis.phasors.labels)} | harmonic_columns(content, joints))


def harmonic_columns(content: HarmonicContent, joints: Iterable[int]) -> dict[str, list[str]]:
    """Odd and even harmonics of the torques of joints by record, those within the noise left out."""
    columns, n = {}, content.odd.shape[1] // 2
    for j in (n + joint for joint in joints):
        clear = content.significance[:, j] > _SIGNIFICANT
        for name, share in (("Odd", content.odd[:, j]), ("Even", content.even[:, j])):
            cells = zip(clear, share.tolist(), strict=True)
            heading = f"{name} τ{j + 1 - n} (%)"
            columns[heading] = [significant(100 * x, 2) if known else "–" for known, x in cells]
    return columns


def show_poses(page: Page, analysis: Analysis) -> None:
    """K and D of each pose alone: they should not depend on it."""
    poses = [record.pose for record in page.study.records]
    given = analysis.phasors, page.study.inertias, poses, analysis.fit
    try:
        fits = page.computed("poses", "Fitting every pose alone", fits_by_pose, *given)
    except JointIdError as error:
        show_info(error)
        return
    st.write(
        "K and D do not depend on the pose. A difference indicates a wrong M2 of one pose or a "
        "hardening gear. Distance of the poses from their mean: in standard errors; about 1 when they "
        "agree."
    )
    columns: dict[str, list[str]] = {"Pose": [*(name or NO_POSE for name in fits.names), "Distance"]}
    pairs = [
        (analysis.unit.shown(value), analysis.unit.shown(error))
        for value, error in zip(fits.estimates, fits.standard_error, strict=True)
    ]
    for k, found in enumerate(analysis.quantities):
        columns[found.heading] = [
            *(with_error(value[k], error[k]) for value, error in pairs),
            significant(float(fits.significance[k]), 2),
        ]
    show_text_table(columns)
    for problem in fits.problems:
        show_info(problem)
