"""Figures of the page Elasticity, one per joint."""

from collections.abc import Callable
from typing import Any, get_args

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
from jointid.figures.torsion import ColourBy
from jointid.ui.shared.charts import choose_segment, download
from jointid.ui.shared.messages import show_text_table
from jointid.ui.shared.page import Page
from jointid.ui.study.overview import freed_note
from jointid.wording import file_stem

_SPREAD = 1.5
"""Largest over smallest torque amplitude from which K over amplitude is worth a plot."""
_DYNAMIC_STIFFNESS = r"""
$(K_j + i\omega D_j)\,a_j = b_j$ (8) with
$\mathbf a = (\mathbf I + \mathbf M_2^{-1}\mathbf M)s^2\mathbf q - \mathbf M_2^{-1}\boldsymbol\tau$ (9)
and $\mathbf b = s^2\boldsymbol\tau - \mathbf M s^4\mathbf q$ (11).
The real part of b/a is K at every frequency, the imaginary part ωD; bars are ± one standard error.
Deviations at some frequencies only indicate friction, a torque delay or wrong inertias.
"""


def figures(page: Page, analysis: Analysis) -> dict[str, Callable[[], None]]:
    """Return the figures that a study allows by their names, the torsion curves first."""
    fit, unit, dark, nominal = analysis.fit, analysis.unit, page.dark, page.study.nominal
    only_sines = not page.study.motion_records  # most figures look at every sine separately
    pose = next(iter(analysis.transfer_matrices), "")
    poses = [record.pose or "" for record in analysis.study.records]
    amplitudes = [curve.amplitude_Nm for curve in fit.torsion_curves]

    def show(
        what: str, draw: Callable[[int], Any], caption: str, heading: str = "**Joint {0}**"
    ) -> None:
        st.caption(caption)
        page.show_per_joint(f"{what} {pose}", draw, what, heading=heading)

    found = {
        "Torsion curve": lambda: _show_torsion(page, analysis),
        "Frequency response": lambda: show(
            "H{0}{0} over frequency, measured and modelled",
            lambda j: element_response(analysis, j, j, pose=pose, dark=dark),
            "Acceleration of each motor over its torque, the controllers removed." + freed_note(fit),
            heading="**H{0}{0}**",
        ),
        "Dynamic stiffness": lambda: show(
            "Dynamic stiffness of joint {0}",
            lambda j: dynamic_stiffness(fit, j, nominal, unit=unit, dark=dark),
            _DYNAMIC_STIFFNESS,
        ),
        "K over amplitude": lambda: show(
            "Stiffness of joint {0} over the torque amplitude of the records",
            lambda j: stiffness_over_amplitude(fit, j, poses, unit=unit, dark=dark),
            "K of each record over its torque amplitude. A linear gear gives a level line; hardening "
            "raises K at large torque, hysteresis at small torque, and backlash lowers it there.",
        ),
        "Residual": lambda: show(
            "Residual torque of joint {0} against noise",
            lambda j: unexplained_torque(fit, j, dark=dark),
            "Torque that the model leaves unexplained in each record. Noise alone leaves the dashes; "
            "points far above them show an effect that the model lacks, and the error bars are widened.",
        ),
    }
    allowed = {
        "Torsion curve": True,
        "Frequency response": bool(analysis.transfer_matrices),
        "Dynamic stiffness": only_sines,
        "K over amplitude": only_sines and all(a.max() > _SPREAD * a.min() for a in amplitudes),
        "Residual": only_sines,
    }
    return {name: show for name, show in found.items() if allowed[name]}


def _show_torsion(page: Page, analysis: Analysis) -> None:
    st.caption(
        "Torque through the gear over its deflection, from motor data alone. The slope of the blue line "
        "is K; damping opens the loops, one per record, drawn with ± two standard errors. Motions "
        "appear as dots."
    )
    by = choose_segment("Colour of the records by", get_args(ColourBy), "torsion_colour")
    joints = page.show_per_joint(
        f"torsion {by}",
        lambda j: torsion_curve(analysis.fit, j, colour_by=by, unit=analysis.unit, dark=page.dark),
        "Torsion curve of joint {0}, torque over deflection with the fitted law",
    )
    each = [gear_terms(analysis.fit, j, analysis.unit) for j in joints]
    names = dict.fromkeys(name for terms in each for name in terms)
    show_text_table(
        {"Gear": list(names)}
        | {
            f"Joint {j + 1}": [terms.get(name, "–") for name in names]
            for j, terms in zip(joints, each, strict=True)
        }
    )
    download(
        "Torsion curves (.csv)",
        lambda: torsion_table(analysis).encode(),
        f"{file_stem(page.study.name)}_torsion.csv",
        "text/csv",
        hint="Torque u = τ − Mθ̈ − friction over deflection θ − θₐ, with M₂θ̈ₐ = u. The mean deflection "
        "of a record is not observable and set to 0.",
    )
