"""Figures of the page Elasticity, one per joint."""

from __future__ import annotations

import streamlit as st

from jointid import Analysis
from jointid.answer import gear_terms
from jointid.exporting import torsion_table
from jointid.figures import (
    dynamic_stiffness,
    element_response,
    stiffness_over_amplitude,
    torsion_curve,
    unexplained_torque,
)
from jointid.ui.shared.charts import download, side_by_side
from jointid.ui.shared.messages import show_text_table
from jointid.ui.shared.page import Page
from jointid.ui.study.overview import freed_note
from jointid.wording import file_stem

_SPREAD = 1.5
"""Largest over smallest torque amplitude from which K over amplitude is worth a plot."""


def show_torsion(page: Page, analysis: Analysis) -> None:
    """Show the torsion curve of every gear, and K over amplitude where the records differ in it."""
    fit = analysis.fit
    st.subheader("Torsion curve of each gear", anchor=False)
    st.caption(
        "Torque through the gear over its wind-up, from motor data alone: s = τ − Mθ̈ − friction, wound "
        "up by θ − θₐ with M₂θ̈ₐ = s. Each loop is one record, or one segment of a motion, with a band "
        "of ± two standard errors; damping opens it. The mean wind-up of a record is not observable and "
        "set to 0. "
        "Amplitudes beyond those tried are not known."
    )
    page.show_per_joint(
        "torsion",
        lambda j: torsion_curve(fit, j, dark=page.dark),
        "Torsion curve of joint {0}, torque over wind-up with the fitted law",
    )
    for j, place in enumerate(side_by_side(fit.n)):
        with place:
            terms = gear_terms(fit, j)
            show_text_table({"": [*terms], f"Joint {j + 1}": [*terms.values()]})
    download(
        "Torsion curves (.csv)",
        lambda: torsion_table(analysis).encode(),
        f"{file_stem(page.study.name)}_torsion.csv",
        "text/csv",
    )
    largest = [curve.amplitude_Nm for curve in fit.torsion_curves]
    sines = not analysis.study.motion_records
    if sines and all(a.max() > _SPREAD * a.min() for a in largest):
        with st.expander("K over amplitude and pose"):
            poses = [record.pose or "" for record in analysis.study.records]
            page.show_per_joint(
                "amplitude",
                lambda j: stiffness_over_amplitude(fit, j, poses, dark=page.dark),
                "Stiffness of joint {0} over the torque amplitude of the records",
            )


def show_dynamic_stiffness(page: Page, analysis: Analysis) -> None:
    """Show b/a of every record over frequency, with its equations."""
    st.subheader("Dynamic stiffness of each record", anchor=False)
    st.latex(
        r"""\begin{gathered}
        (K_j + i\omega D_j)\,a_j = b_j \quad (8) \\
        \mathbf a = (\mathbf I + \mathbf M_2^{-1}\mathbf M)s^2\mathbf q
        - \mathbf M_2^{-1}\boldsymbol\tau \quad (9) \\
        \mathbf b = s^2\boldsymbol\tau - \mathbf M s^4\mathbf q \quad (11)
        \end{gathered}"""
    )
    st.caption(
        "The real part of b/a is K at every frequency, the imaginary part grows as ωD. Bars: ± one "
        "standard error. Points that leave the lines at some frequencies only tell of friction, a "
        "torque delay, or inertias that are off; a joint that hardly moves in a record tells "
        "little there."
    )
    page.show_per_joint(
        "stiffness",
        lambda j: dynamic_stiffness(analysis.fit, j, page.study.nominal, dark=page.dark),
        "Dynamic stiffness of joint {0}",
    )


def show_unexplained(page: Page, analysis: Analysis) -> None:
    """Show the residual torque of every record against noise."""
    st.subheader("What the model leaves unexplained", anchor=False)
    st.caption(
        "Points at the height of the dashes: noise explains the rest. Points far above: there the model "
        "is wrong, not the noise, and the error bars are widened accordingly."
    )
    page.show_per_joint(
        "unexplained",
        lambda j: unexplained_torque(analysis.fit, j, dark=page.dark),
        "Unexplained torque of joint {0} against noise",
    )


def show_response(page: Page, analysis: Analysis) -> None:
    """Show the diagonal of H of the first pose, models over measurement."""
    st.subheader("Fit over measurement", anchor=False)
    st.caption(
        "The identified and the nominal model over the transfer matrix." + freed_note(analysis.fit)
    )
    pose = next(iter(analysis.transfer_matrices))
    page.show_per_joint(
        f"fit {pose}",
        lambda j: element_response(analysis, j, j, pose=pose, dark=page.dark),
        "H{0}{0} over frequency, measured and modelled",
        heading="**H{0}{0}**",
    )
