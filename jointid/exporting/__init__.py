"""Results for other tools: one file per idea, text or bytes out, nothing is written to disk here."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
