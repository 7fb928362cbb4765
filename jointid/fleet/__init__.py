"""A fleet: thousands of studies analysed on this computer or on a Dask cluster, one row each.

    from jointid.fleet import analyse_fleet, read_fleet

    summary = analyse_fleet(["cells/*/2026-*.zip"], "results.parquet", workers=4)
    rows = read_fleet(summary.out)

``worker.py`` turns a study into its row; ``local.py`` and ``cluster.py`` run it.
"""

from jointid.background.child_process import Limits
from jointid.fleet.row import Row
from jointid.fleet.run import Progress, Summary, analyse_fleet
from jointid.fleet.studies import find_studies
from jointid.fleet.table import read_rows as read_fleet

__all__ = [
    "Limits",
    "Progress",
    "Row",
    "Summary",
    "analyse_fleet",
    "find_studies",
    "read_fleet",
]
