"""Stiffness and damping of elastic robot joints, and what knowing them is worth in millimetres."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
