"""Libraries that only some log formats need."""

from importlib import import_module
from typing import Any

from jointid.errors import JointIdError


def import_optional(module: str, package: str, needed_for: str, extra: str = "import") -> Any:
    """Import a module of an optional library.

    Raises JointIdError when it is not installed; the message names the package.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise JointIdError(
            f"{needed_for} need the package {package}, which is not installed. "
            f'Install it with: pip install "jointid[{extra}]" (or: pip install {package}).'
        ) from error
