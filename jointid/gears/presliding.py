"""Presliding friction of motors in motion records, by Dahl's model."""

from collections.abc import Mapping

from scipy.integrate import cumulative_simpson

from jointid.arrays import Complexes, Floats
from jointid.gears.dahl import dahl
from jointid.phasors.segment import Segment, bins_of


def presliding_bins(segments: Mapping[int, Segment], sharpness: Floats) -> dict[int, Complexes]:
    """Phasors of Dahl's z over the motor angles in the bins of each segment, (highest, n), by its row.

    The sharpness, shape (n, 1), is one over the presliding angle. The first presliding angles of
    a record's motion bring z to its true value, if its start is wrong.
    """
    of_records: dict[int, Floats] = {}
    found = {}
    for row, segment in segments.items():
        velocity = segment.uniform_velocity  # that of all segments of a record
        if id(velocity) not in of_records:
            angle = cumulative_simpson(velocity, dx=segment.interval_s, axis=1, initial=0)
            of_records[id(velocity)] = dahl(angle, sharpness)
        z = of_records[id(velocity)][:, segment.begin : segment.end]
        found[row] = bins_of(z, segment.highest).T
    return found
