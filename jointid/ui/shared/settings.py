"""The settings of the whole study, chosen in the sidebar."""

import inspect
from collections.abc import Mapping, Sequence

from jointid import analyse
from jointid.answer import STIFFNESS_UNITS
from jointid.estimation.identify_elasticity import METHODS

DEFAULT_METHOD = str(inspect.signature(analyse).parameters["method"].default)
"""The default estimator of ``analyse``."""
ESTIMATORS = {DEFAULT_METHOD: METHODS.get(DEFAULT_METHOD, "chosen for these records")} | METHODS
"""Estimators with their descriptions, the default first."""
SETTINGS: Mapping[str, Sequence[str]] = {"estimator": [*ESTIMATORS], "unit": [*STIFFNESS_UNITS]}
"""Options of each setting by its key, the default first."""
