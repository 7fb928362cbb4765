"""Figures of a report with their explanations: frequency responses and cut."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from jointid.analysis import NOT_USABLE, Analysis, ArmSideAnalysis
from jointid.answer import gear_text, without_curve
from jointid.cut.outcome import (
    ZONES_M,
    Outcome,
    at_most,
    cut_outcome,
    remaining_error_text,
    study_outcome,
)
from jointid.cut.path_deflection import COLUMNS_MEANING, meaning, own_path_deflections, rows_of
from jointid.cut.rectangle import rectangle
from jointid.cut.robot import CUTTING_POINT_M
from jointid.cut.tracking import TrackingRun
from jointid.errors import JointIdError
from jointid.figures.response_curves import element_name, removed_effects
from jointid.reporting.blocks import Block, Figure, Paragraph, Table
from jointid.reporting.figures import (
    PAGE_WIDTH,
    cut_figure,
    deflection_figure,
    element_figure,
    single_record_figure,
    torsion_figure,
)
from jointid.wording import capitalised, chosen

_GAP = 12.0
"""Between two figures side by side, points."""


def response_blocks(analysis: Analysis, numbers: Iterator[str]) -> Iterator[Block]:
    """Figures 3 to 5 of the paper, for every pose that allows them; ``numbers`` names them."""
    n = analysis.study.inertia.n
    text = (
        "Acceleration of each motor over its torque. A single record (first figure) includes the "
        "controllers of the other joints; equations (17)–(18) remove their effect from H₁₁, H₂₂ by "
        "combining the records of each frequency. "
        if n > 1
        else "Acceleration of the motor over its torque. "
    )
    if removed := removed_effects(analysis):
        text += f"Filled points: {removed}, as identified here; open points: as measured. "
    yield Paragraph(
        f"{text}The blue line is the model with the identified K and D, not a curve through the points. "
        "Bars are ± one standard error where they exceed the mark."
    )
    if analysis.transfer_problem:
        yield Paragraph(analysis.transfer_problem, "quiet")
    sine_poses = {record.pose or "" for record in analysis.study.sine_records}
    for pose in dict.fromkeys(record.pose or "" for record in analysis.study.records):
        suffix = f', pose "{pose}"' if pose else ""
        if n > 1 and pose in sine_poses:
            yield Figure(
                (single_record_figure(analysis, 0, pose=pose),),
                f"{next(numbers)} Motor 1, each record alone{suffix} (Figure 3 of the paper).",
            )
        if pose not in analysis.transfer_matrices:
            continue
        for joints, width in _pairs(n):
            names = " and ".join(element_name(j, j) for j in joints)
            paper = {0: " (Figures 4 and 5 of the paper)" if n > 1 else " (Figure 4 of the paper)"}
            yield Figure(
                tuple(element_figure(analysis, j, pose=pose, width=width) for j in joints),
                f"{next(numbers)} {names}{suffix}{paper.get(joints[0], '')}.",
            )


def sensor_blocks(found: ArmSideAnalysis, numbers: Iterator[str]) -> Iterator[Block]:
    """K of every joint from its sensor, with measured and fitted deflection."""
    fit, motions = found.fit, found.study.motion_records
    caption = f"{found.error_bars} Skew: age of the sample behind the gear relative to the motor's."
    yield replace(Table.of(found.table, caption, "lrrl"), kind="answer")
    which, record = next(
        (record.label or f"motion record {k}", record)
        for k, record in enumerate(motions, start=1)
        if record.arm_rad is not None
    )
    yield Paragraph(
        "The difference between the two encoders of a joint is the deflection of its gear. Black: "
        "measured; blue: fitted from the torque of the robot model. A constant offset is removed."
    )
    time_s, measured, fitted = fit.deflection(record)
    for j in (j for j, joint in enumerate(fit.joints) if joint is not None):
        if np.isfinite(measured[:, j]).all():
            yield Figure(
                (deflection_figure(time_s, measured[:, j], fitted[:, j], j),),
                f"{next(numbers)} Deflection of the gear of joint {j + 1}, {which}."
                + " K is not determined." * bool(fit.reasons[j]),
            )


def torsion_blocks(analysis: Analysis, numbers: Iterator[str]) -> Iterator[Block]:
    """Torsion curve of every gear, with the terms of catalogues."""
    fit = analysis.fit
    yield Paragraph(
        "Torque through each gear over its deflection, from motor data alone. The blue line is the "
        "fitted elastic law; damping and hysteresis open the measured loops, which are coloured from "
        "violet at the lowest frequency to yellow at the highest and drawn with ± two standard errors. "
        f"The mean deflection of a record is not observable and is set to 0. {without_curve(fit)}"
    )
    for joints, width in _pairs(fit.n):
        terms = [f" {gear_text(fit, j, analysis.unit)}." for j in joints]
        yield Figure(
            tuple(torsion_figure(analysis, j, width=width) for j in joints),
            f"{next(numbers)} Torsion curves, {analysis.unit.of_gear(0).side}."
            + "".join(terms) * (analysis.state != NOT_USABLE),
        )


def _pairs(n: int) -> Iterator[tuple[list[int], float]]:
    """Joints whose figures are side by side, and the width of each."""
    width = (PAGE_WIDTH - _GAP) / 2 if n > 1 else PAGE_WIDTH
    for first in range(0, n, 2):
        yield [j for j in (first, first + 1) if j < n], width


def outcome_of(analysis: Analysis) -> tuple[Outcome | None, str]:
    """The simulated cut before and after, or the reason for its absence; two joints only."""
    try:
        return study_outcome(analysis), ""
    except JointIdError as error:
        return None, f"No cut is shown. {error}"


def cut_blocks(outcome: Outcome | None, problem: str, numbers: Iterator[str]) -> Iterator[Block]:
    """Figure 7 of the paper with its assumptions."""
    if outcome is None:
        yield Paragraph(problem)
        return
    assumed = outcome.assumed
    servo = (
        "assumes rigid joints"
        if assumed is None
        else f"assumes K = {chosen(assumed.K)} N·m/rad and D = {chosen(assumed.D)} N·m·s/rad"
    )
    friction = outcome.robot.friction
    left = "" if outcome.depends_on_elasticity else remaining_error_text(outcome, friction=friction)
    yield Paragraph(
        "The same path, a rectangle of 28 × 45 mm at 300 mm/s, cut before and after. Before: a robot "
        f"with the identified K{' and D' if friction is None else ', D and friction'}, whose servo "
        f"{servo}. "
        "After: the servo assumes the identified values. "
        + (
            "K and D of the robot are drawn from the error bars: of "
            f"{outcome.distribution.K.shape[0]} robots, 95 % stay {at_most(outcome.after_m)} "
            f"in the largest corner zone, {1e3 * ZONES_M[-1]:g} mm; the figure shows it for each zone."
            if outcome.distribution is not None
            else f"The robot has exactly these values. {outcome.problem}"
        )
        + (left and f" {left}")
    )
    cuts = {}
    for zone in ZONES_M:
        label = f"corner zone {1e3 * zone:g} mm"
        try:
            cuts[label] = _cuts(outcome, zone)
        except JointIdError as error:
            yield Paragraph(f"{capitalised(label)}: {error}", "quiet")
    if cuts:
        heading = f"Before: nominal {'(rigid)' if assumed is None else 'K and D'}"
        yield Figure(
            (cut_figure((heading, "After: identified K and D"), cuts),),
            f"{next(numbers)} Cut paths and their largest path errors; grey is the reference path "
            "(Figure 7 of the paper).",
        )
    yield Paragraph(
        f"{outcome.robot.meaning} The paper does not state "
        "geometry, inertias, zone sizes or non-optimal parameters: arm, corner zones and the "
        "servo's values before identification are assumptions of this software or of the study. "
        "Both robots are simulated.",
        "quiet",
    )


def own_path_blocks(analysis: Analysis) -> Iterator[Block]:
    """Deflection of the study's own robot along the path, by corner zone."""
    try:
        found = own_path_deflections(analysis, ZONES_M)
    except JointIdError as error:
        yield Paragraph(f"The tool deflection cannot be computed. {error}")
        return
    header, rows = rows_of([1e3 * zone for zone in ZONES_M], found)
    yield Table(tuple(header), tuple(map(tuple, rows)), f"{meaning(analysis)} {COLUMNS_MEANING}")


def _cuts(outcome: Outcome, zone_m: float) -> tuple[TrackingRun, TrackingRun]:
    """The cuts before and after with another corner zone."""
    robot, path = outcome.robot, rectangle(zone_m=zone_m, centre_m=CUTTING_POINT_M)
    if np.array_equal(path.knot_m, outcome.toolpath.knot_m):
        return outcome.before, outcome.after
    other = cut_outcome(robot, path, outcome.assumed, friction=robot.friction)
    return other.before, other.after
