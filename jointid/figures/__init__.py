"""Results as plotly figures: one file per idea, nothing is computed here that a result does not hold."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
