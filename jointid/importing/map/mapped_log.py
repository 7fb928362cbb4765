"""Convert a table to angles and torques in SI units, motor side."""

from dataclasses import dataclass, replace

import numpy as np

from jointid.arrays import Floats, set_fields
from jointid.errors import JointIdError
from jointid.importing.columns.log_table import LogTable
from jointid.importing.map.mapping import Mapping
from jointid.importing.map.sample_times import on_one_clock, sample_times
from jointid.importing.map.unwrap import unwrapped
from jointid.records import JointRecord
from jointid.wording import counted, listed


@dataclass(frozen=True, eq=False)
class MappedLog(JointRecord):
    """A log in SI units, motor side; it may have gaps, so its interval is the median one.

    Raises JointIdError for the same faults as a record.
    """

    name: str = ""
    arm_rad: Floats | None = None
    """Angles behind the gears, shape (N, n), rad; NaN columns for joints without a second sensor."""
    notes: tuple[str, ...] = ()
    """Omissions and repairs, as sentences for the user."""

    def __post_init__(self) -> None:
        super().__post_init__()
        set_fields(self, interval_s=float(np.median(np.diff(self.time_s))))

    def rows(self, start_s: float, stop_s: float) -> slice:
        """Rows from ``start_s`` to ``stop_s``, both included."""
        tolerance = 1e-6 * self.interval_s
        return slice(
            int(np.searchsorted(self.time_s, start_s - tolerance)),
            int(np.searchsorted(self.time_s, stop_s + tolerance, side="right")),
        )


def apply_mapping(table: LogTable, mapping: Mapping) -> MappedLog:
    """Convert the columns of a log to motor angles and torques in SI units.

    θ_motor = sign · ratio · θ_joint and τ_motor = sign · τ_joint / ratio for channels on the joint side;
    arm-side positions stay at the joint. Rows with a missing value and copies are left out; notes count
    them and name gaps. Signals with separate clocks are interpolated at the times of the slowest, with a
    note. Raises JointIdError when a column is missing or not chosen, too few rows are complete, or the
    times do not increase.
    """
    names = mapping.columns
    if mapping.open_roles:
        left = [name for name in table.names if name not in names]
        remedy = f"Choose one of: {listed(left)}." if left else "The log has no other column of numbers."
        raise JointIdError(
            f"{table.name}: no column is chosen for {listed(mapping.open_roles)}. {remedy}"
        )
    mapping, without = _without_empty_sensors(table, mapping)
    names = mapping.columns
    raw = [table.column(name).values for name in names]
    time = raw.pop(0) if mapping.time.column else np.arange(table.rows, dtype=float)
    raw, clock_note = on_one_clock(mapping, time, raw)
    complete = np.isfinite(time)
    for column in raw:
        complete &= np.isfinite(column)
    kept = int(complete.sum())
    if kept < 2:
        empty = [n for n in names if not np.isfinite(table.column(n).values).any()]
        which = f" Empty columns: {listed(empty)}." if empty else ""
        raise JointIdError(
            f"{table.name}: {counted(kept, 'row')} with numbers in all of {listed(names)}.{which} "
            "Choose other columns."
        )
    notes = [*table.notes, *without, *([clock_note] if clock_note else [])]
    if kept < table.rows and not clock_note:
        first = int(np.argmin(complete))
        missed = table.rows - kept
        said = "lacks a value and was" if missed == 1 else "lack a value and were"
        notes.append(
            f"{missed} of {table.rows} rows {said} left out; the first is {table.place(first)}."
        )
    rows = np.flatnonzero(complete)
    signals = [column[rows] for column in raw]
    time_s, used, repairs = sample_times(table, mapping.time, rows, time[rows], signals)
    rows = rows[used]
    notes += repairs
    n = mapping.n
    arms = [j for j, joint in enumerate(mapping.joints) if joint.arm]
    arm = np.full((rows.size, n), np.nan, order="F") if arms else None
    theta, tau = np.empty((rows.size, n), order="F"), np.empty((rows.size, n), order="F")
    for j, joint in enumerate(mapping.joints):
        position = unwrapped(raw[j][rows], joint.position)
        if position.jumps.size:
            first = table.first_row + int(rows[position.jumps[0]])
            notes.append(position.note(joint.position, f", first at {table.row_word} {first}"))
        with np.errstate(over="ignore"):  # damaged values become infinite, which MappedLog refuses
            theta[:, j] = position.values * joint.rad_per_unit
            tau[:, j] = raw[n + j][rows] * joint.Nm_per_unit
        if arm is not None and joint.arm:
            behind = unwrapped(raw[2 * n + arms.index(j)][rows], joint.arm)
            arm[:, j] = behind.values * joint.arm.rad_per_unit
    return MappedLog(
        time_s=time_s,
        theta_rad=theta,
        tau_Nm=tau,
        arm_rad=arm,
        torque_hold=mapping.torque_hold,
        torque_delay_s=mapping.torque_delay_s,
        name=table.name,
        notes=tuple(notes),
    )


def _without_empty_sensors(table: LogTable, mapping: Mapping) -> tuple[Mapping, list[str]]:
    """Leave out sensors behind the gears without a single value, which would cost all rows."""
    joints, notes = list(mapping.joints), []
    for j, joint in enumerate(joints):
        if joint.arm and not np.isfinite(table.column(joint.arm.column).values).any():
            joints[j] = replace(joint, arm=None)
            notes.append(
                f'The column "{joint.arm.column}" has no value: joint {j + 1} is read without its '
                "sensor behind the gear."
            )
    return replace(mapping, joints=tuple(joints)), notes
