"""Figures of the page Elasticity, one per joint."""

from __future__ import annotations

from collections.abc import Callable

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
from jointid.ui.shared.charts import download
from jointid.ui.shared.messages import show_text_table
from jointid.ui.shared.page import Page
from jointid.ui.study.overview import freed_note
from jointid.wording import file_stem

_SPREAD = 1.5
"""Largest over smallest torque amplitude from which K over amplitude is worth a plot."""


def figures(page: Page, analysis: Analysis) -> dict[str, Callable[[], None]]:
    """Return the figures that a study allows by their names, the torsion curves first."""
    found = {"Torsion curve": lambda: _show_torsion(page, analysis)}
    if analysis.transfer_matrices:
        found["Frequency response"] = lambda: _show_response(page, analysis)
    if page.study.motion_records:  # the others look at every sine by itself
        return found
    found["Dynamic stiffness"] = lambda: _show_dynamic_stiffness(page, analysis)
    amplitudes = [curve.amplitude_Nm for curve in analysis.fit.torsion_curves]
    if all(a.max() > _SPREAD * a.min() for a in amplitudes):
        found["K over amplitude"] = lambda: _show_amplitudes(page, analysis)
    return found | {"Residual": lambda: _show_residual(page, analysis)}


def _show_torsion(page: Page, analysis: Analysis) -> None:
    st.caption(
        "Torque through the gear over its wind-up, from motor data alone. The slope of the blue line is "
        "K; damping opens the loops, one per record or segment, drawn with ± two standard errors."
    )
    page.show_per_joint(
        "torsion",
        lambda j: torsion_curve(analysis.fit, j, dark=page.dark),
        "Torsion curve of joint {0}, torque over wind-up with the fitted law",
    )
    each = [gear_terms(analysis.fit, j) for j in range(analysis.fit.n)]
    names = dict.fromkeys(name for terms in each for name in terms)
    show_text_table(
        {"Joint": [f"{j}" for j in range(1, len(each) + 1)]}
        | {name: [terms.get(name, "–") for terms in each] for name in names}
    )
    download(
        "Torsion curves (.csv)",
        lambda: torsion_table(analysis).encode(),
        f"{file_stem(page.study.name)}_torsion.csv",
        "text/csv",
        hint="Torque s = τ − Mθ̈ − friction over wind-up θ − θₐ, with M₂θ̈ₐ = s. The mean wind-up of a "
        "record is not observable and set to 0.",
    )


def _show_amplitudes(page: Page, analysis: Analysis) -> None:
    poses = [record.pose or "" for record in analysis.study.records]
    st.caption("K of each record over its torque amplitude. A linear gear gives a level line.")
    page.show_per_joint(
        "amplitude",
        lambda j: stiffness_over_amplitude(analysis.fit, j, poses, dark=page.dark),
        "Stiffness of joint {0} over the torque amplitude of the records",
    )


def _show_dynamic_stiffness(page: Page, analysis: Analysis) -> None:
    st.latex(
        r"""\begin{gathered}
        (K_j + i\omega D_j)\,a_j = b_j \quad (8) \\
        \mathbf a = (\mathbf I + \mathbf M_2^{-1}\mathbf M)s^2\mathbf q
        - \mathbf M_2^{-1}\boldsymbol\tau \quad (9) \\
        \mathbf b = s^2\boldsymbol\tau - \mathbf M s^4\mathbf q \quad (11)
        \end{gathered}"""
    )
    st.caption(
        "The real part of b/a is K at every frequency, the imaginary part ωD; bars are ± one standard "
        "error. Deviations at some frequencies only indicate friction, a torque delay or wrong inertias."
    )
    page.show_per_joint(
        "stiffness",
        lambda j: dynamic_stiffness(analysis.fit, j, page.study.nominal, dark=page.dark),
        "Dynamic stiffness of joint {0}",
    )


def _show_residual(page: Page, analysis: Analysis) -> None:
    st.caption(
        "Torque that the model leaves unexplained in each record. Noise alone leaves the dashes; points "
        "far above them show an effect that the model lacks, and the error bars are widened."
    )
    page.show_per_joint(
        "unexplained",
        lambda j: unexplained_torque(analysis.fit, j, dark=page.dark),
        "Residual torque of joint {0} against noise",
    )


def _show_response(page: Page, analysis: Analysis) -> None:
    st.caption(
        "Acceleration of each motor over its torque, the controllers removed: models as lines, measured "
        "points." + freed_note(analysis.fit)
    )
    pose = next(iter(analysis.transfer_matrices))
    page.show_per_joint(
        f"fit {pose}",
        lambda j: element_response(analysis, j, j, pose=pose, dark=page.dark),
        "H{0}{0} over frequency, measured and modelled",
        heading="**H{0}{0}**",
    )
