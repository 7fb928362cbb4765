"""The pages in the order of the method, each with a one-line description."""

from __future__ import annotations

from dataclasses import dataclass

from jointid.verdict.evidence import Action


@dataclass(frozen=True)
class Step:
    """One page."""

    path: str
    """Relative to app.py."""
    name: str
    line: str
    """Description in one line."""


OVERVIEW = Step("app.py", "Study", "The answer, and what to know before it is trusted.")
RECORDS = Step("pages/1_Records.py", "Records", "What was logged: each joint's angle and torque.")
METHOD = (
    RECORDS,
    Step("pages/2_Phasors.py", "Phasors", "Each sine becomes one complex number."),
    Step("pages/3_Transfer_matrix.py", "Transfer matrix", "The robot without its controllers."),
    Step("pages/4_Elasticity.py", "Elasticity", "Stiffness and damping of every joint."),
    Step("pages/5_Cut.py", "Cut", "What knowing them is worth, in millimetres."),
    Step("pages/6_Plan.py", "Plan", "The records that would cut the error bars most."),
    Step("pages/7_Report.py", "Report", "To hand on: a report, and files for other tools."),
    Step("pages/10_Fleet.py", "Fleet", "Many studies side by side: spread, drift, what stands out."),
)
"""The steps of the method."""

SIMULATE = Step("pages/8_Simulate.py", "Simulate a robot", "Records of a robot whose springs are known.")
IMPORT = Step(
    "pages/9_Import_a_log.py", "Import a log", "Logs of any controller: columns named, sine runs found."
)

ACTIONS: dict[Action, tuple[Step, str]] = {
    "edit mapping": (IMPORT, "All entries"),
    "edit runs": (IMPORT, "Correct the runs"),
    "edit inertias": (IMPORT, "The robot"),
}
"""Page of each action that a finding asks for, and how the label of its part begins."""
