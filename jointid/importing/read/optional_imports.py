"""Libraries that only some kinds of log need."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from jointid.errors import JointIdError


def extra(module: str, package: str, needed_for: str) -> Any:
    """Return an optional library's module.

    Raises
    ------
    JointIdError
        When it is not installed; the message says what to install.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise JointIdError(
            f"{needed_for} need the package {package}, which is not installed. "
            f'Install it with: pip install "jointid[import]" (or: pip install {package}).'
        ) from error
