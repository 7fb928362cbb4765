"""Any controller's log in, a study out: read tables, map columns, cut segments, make records."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
