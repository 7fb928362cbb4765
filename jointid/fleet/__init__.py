"""A fleet: thousands of studies analysed on this computer or on a Dask cluster, one row each.

    from jointid.fleet import analyse_fleet, read_fleet

    summary = analyse_fleet(["cells/*/2026-*.zip"], "results.parquet", workers=4)
    rows = read_fleet(summary.out)

From study to row (``row.py``, ``worker.py``) the way is the same wherever it runs; ``local.py`` and
``cluster.py`` say where.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
