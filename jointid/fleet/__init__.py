"""A fleet: thousands of studies analysed on this computer or on a Dask cluster, one row each.

    from jointid.fleet import analyse_fleet, read_fleet

    summary = analyse_fleet(["cells/*/2026-*.zip"], "results.parquet", workers=4)
    rows = read_fleet(summary.out)

``worker.py`` turns a study into its row; ``jobs.py`` and ``cluster.py`` run it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
