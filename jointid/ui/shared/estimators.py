"""The estimators that the sidebar offers."""

import inspect

from jointid import analyse
from jointid.estimation.identify_elasticity import METHODS

DEFAULT_METHOD = str(inspect.signature(analyse).parameters["method"].default)
"""The default estimator of ``analyse``."""

ESTIMATORS = {DEFAULT_METHOD: METHODS.get(DEFAULT_METHOD, "chosen for these records")} | METHODS
"""Estimators with their descriptions, the default first."""
