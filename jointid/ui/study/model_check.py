"""Model validation: prediction of left-out records, residuals, harmonics, poses, amplitudes."""

from functools import partial

import numpy as np
import streamlit as st

from jointid import Analysis, JointIdError
from jointid.analysis import NOT_USABLE
from jointid.figures.uncertainty import harmonic_bars, left_out_prediction, normalised_residuals
from jointid.ui.shared.charts import NO_POSE
from jointid.ui.shared.messages import show_info, show_note, show_text_table
from jointid.ui.shared.page import Page
from jointid.uncertainty.poses import fits_by_pose
from jointid.uncertainty.torque_prediction import TorquePrediction, predict_torques
from jointid.uncertainty.validation import (
    Prediction,
    amplitude_dependence,
    harmonic_content,
    predict_left_out,
    record_residuals,
)
from jointid.verdict.rules_model import EXPLAINED
from jointid.wording import significant, with_error


def _predicted(page: Page, analysis: Analysis) -> Prediction | TorquePrediction:
    """H of one pose; of motions and several poses, which have no single H, the torques of the gears."""
    study, fit = analysis.study, analysis.fit
    doing = "Fitting half of the frequencies, predicting the other"
    if study.motion_records or any(inertia is not study.inertias[0] for inertia in study.inertias):
        return page.computed("prediction", doing, predict_torques, fit)
    given = analysis.phasors, study.inertias[0], fit
    return page.computed("prediction", doing, predict_left_out, *given)


def show_prediction(page: Page, analysis: Analysis) -> None:
    """Prediction of the records left out of the fit, or the reason for its absence."""
    if analysis.state == NOT_USABLE:
        return
    try:
        prediction = _predicted(page, analysis)
    except JointIdError as error:
        show_note(f"No prediction of records left out of the fit. {error}")
        return
    show_note(_sentence(prediction))


def _sentence(prediction: Prediction | TorquePrediction) -> str:
    """Size of the deviation, judged as the verdict judges the misfit of all records."""
    apart = significant(100 * float(np.median(prediction.relative_error)), 2)
    times, limit = (significant(float(np.sqrt(x)), 2) for x in (prediction.misfit, EXPLAINED))
    what = "gear torques" if isinstance(prediction, TorquePrediction) else "motor accelerations"
    text = (
        f"Fitted to half of the frequencies, K and D predict the {what} at the others within {apart} %"
    )
    sigmas = f"({times} σ; noise alone: up to {limit} σ)."
    if prediction.misfit <= EXPLAINED:
        return f"{text}, as expected from noise {sigmas}"
    return (
        f"{text}, more than noise explains {sigmas} The model lacks an effect, or these records show "
        "less than the whole fit takes into account."
    )


def show_model_holds(page: Page, analysis: Analysis) -> None:
    """Prediction, residuals and harmonics; amplitudes when a study has several."""
    st.markdown("**Prediction of records left out of the fit**")
    try:
        prediction = _predicted(page, analysis)
    except JointIdError as error:
        show_info(error)
    else:
        show_note(_sentence(prediction))
        if isinstance(prediction, Prediction):
            what = "Measured and predicted H over frequency, and their relative difference"
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
    _show_harmonics(page, analysis)
    _show_amplitudes(analysis)


def _show_harmonics(page: Page, analysis: Analysis) -> None:
    try:
        content = harmonic_content(analysis.phasors)
    except JointIdError as error:
        show_info(error)
        return
    st.markdown("**Harmonics of the torques**")
    caption = (
        "A linear gear has no harmonics of the excitation. Odd harmonics indicate friction, even ones "
        "backlash or a one-sided load. Pale bars: within the noise."
    )
    n, labels = analysis.fit.n, analysis.phasors.labels
    page.show_per_joint(
        "harmonics",
        lambda j, dark: harmonic_bars(content, n + j, labels, dark=dark),
        "Harmonics of the torque of joint {0}",
        caption=caption,
    )


def _show_amplitudes(analysis: Analysis) -> None:
    found = amplitude_dependence(analysis.fit)
    known = np.flatnonzero(np.isfinite(found.standard_error))
    if not known.size:
        return
    st.markdown("**Stiffness over amplitude**")
    lines = []
    for j in known:
        low, high = (significant(1e3 * float(x), 2) for x in found.deflection_rad[j])
        change = with_error(100 * float(found.change[j]), 100 * float(found.standard_error[j]))
        lines.append(f"- Joint {j + 1}: {change} % from {low} to {high} mrad of deflection.")
    st.markdown("\n".join(lines))


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
        "hardening gear. Distance: of the poses from their mean, in standard errors; about 1 when they "
        "agree."
    )
    columns: dict[str, list[str]] = {"Pose": [*(name or NO_POSE for name in fits.names), "Distance"]}
    pairs = [
        (analysis.unit.shown(value), analysis.unit.shown(error))
        for value, error in zip(fits.estimates, fits.standard_error, strict=True)
    ]
    for k, found in enumerate(analysis.quantities):
        columns[f"{found.name} ({found.unit})"] = [
            *(with_error(value[k], error[k]) for value, error in pairs),
            significant(float(fits.significance[k]), 2),
        ]
    show_text_table(columns)
    for problem in fits.problems:
        show_info(problem)
