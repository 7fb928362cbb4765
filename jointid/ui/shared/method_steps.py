"""The pages in the order of the method, each with a one-line description."""

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


OVERVIEW = Step("app.py", "Study", "The answer, its error bars and the verdict.")
RECORDS = Step("pages/1_Records.py", "Records", "Logged position and torque of each joint.")
SIMULATE = Step("pages/8_Simulate.py", "Simulate a robot", "Records of a robot with known K and D.")
IMPORT = Step("pages/9_Import_a_log.py", "Import a log", "A log of any controller becomes a study.")
PHASORS = Step("pages/2_Phasors.py", "Phasors", "Each sine becomes one complex number.")
TRANSFER = Step("pages/3_Transfer_matrix.py", "Transfer matrix", "The robot without its controllers.")
ELASTICITY = Step("pages/4_Elasticity.py", "Elasticity", "Stiffness and damping of every joint.")
CUT = Step("pages/5_Cut.py", "Cut", "Path error with nominal and identified K and D.")
PLAN = Step("pages/6_Plan.py", "Plan", "Records that reduce the error bars most.")
REPORT = Step("pages/7_Report.py", "Report and export", "A report, and files for other tools.")
REPORT_AT_ONCE = "report_at_once"
"""Key in the session of the study whose report is made without a click."""
FLEET = Step("pages/10_Fleet.py", "Fleet", "Many studies side by side: spread, drift, outliers.")
COMPARE = Step("pages/11_Compare.py", "Compare", "Two studies side by side, with their differences.")
GLOSSARY = Step("pages/12_Glossary.py", "Glossary", "The terms used on these pages.")
GROUPS = {
    "Data": (OVERVIEW, RECORDS, IMPORT, SIMULATE),
    "Method": (PHASORS, TRANSFER, ELASTICITY),
    "Use": (CUT, PLAN, REPORT, COMPARE, FLEET, GLOSSARY),
}
"""The pages as the sidebar groups them."""
METHOD = (RECORDS, PHASORS, TRANSFER, ELASTICITY, CUT, PLAN, REPORT)
"""The steps of the method for one study."""

OPEN_LOGS = "dropped_logs"
"""Key of the session under which the import holds its files."""
ACTIONS: dict[Action, tuple[Step, str]] = {
    "edit columns": (IMPORT, "2 Columns"),
    "edit mapping": (IMPORT, "3 Drive data"),
    "edit runs": (IMPORT, "4 Runs"),
    "edit inertias": (IMPORT, "5 Inertias"),
}
"""Page of each action that a finding asks for, and how the label of its part begins."""
