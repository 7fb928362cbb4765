"""Results as plotly figures: one file per idea, nothing is computed here that a result does not hold."""

from jointid.figures.condition import torque_condition
from jointid.figures.phasor_plane import phasor_plane
from jointid.figures.response import (
    element_response,
    model_over_measurement,
    single_record,
)
from jointid.figures.springs import dynamic_stiffness, unexplained_torque
from jointid.figures.waveforms import raw_columns, spectra, waveforms

__all__ = [
    "dynamic_stiffness",
    "element_response",
    "model_over_measurement",
    "phasor_plane",
    "raw_columns",
    "single_record",
    "spectra",
    "torque_condition",
    "unexplained_torque",
    "waveforms",
]
