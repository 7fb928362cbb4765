"""Convert a table to angles and torques in SI units, motor side."""

from dataclasses import dataclass, field

import numpy as np

from jointid.arrays import Floats, finite_array, set_fields
from jointid.errors import JointIdError
from jointid.importing.columns.log_table import LogTable
from jointid.importing.map.mapping import Mapping
from jointid.importing.map.sample_times import on_one_clock, sample_times
from jointid.importing.map.unwrap import unwrapped
from jointid.wording import counted, listed


@dataclass(frozen=True, eq=False)
class MappedLog:
    """A log in SI units, motor side."""

    time_s: Floats
    """Strictly increasing times, shape (N,), s."""
    theta_rad: Floats
    """Motor angles, shape (N, n), rad."""
    tau_Nm: Floats
    """Motor torques, shape (N, n), N·m."""
    torque_hold: bool = False
    torque_delay_s: float = 0.0
    name: str = ""
    arm_rad: Floats | None = None
    """Angles behind the gears, shape (N, n), rad; NaN columns for joints without a second sensor."""
    notes: tuple[str, ...] = ()
    """Omissions and repairs, as sentences for the user."""
    interval_s: float = field(init=False)
    """Median sample interval, s."""

    def __post_init__(self) -> None:
        time = finite_array("time_s", self.time_s, ndim=1)
        theta = finite_array("theta_rad", self.theta_rad, ndim=2, order="F")
        tau = finite_array("tau_Nm", self.tau_Nm, ndim=2, order="F")
        if theta.shape != tau.shape or len(theta) != time.size or theta.shape[1] == 0:
            raise JointIdError(
                f"time_s, theta_rad and tau_Nm have shapes {time.shape}, {theta.shape} and {tau.shape}: "
                "expected (N,), (N, n) and (N, n)."
            )
        steps = np.diff(time)
        late = np.flatnonzero(steps <= 0)
        if time.size < 2 or late.size:
            fault = f"has {counted(time.size, 'value')}"
            if late.size:
                before, after = time[late[0] : late[0] + 2]
                fault = f"goes from {before:.12g} s to {after:.12g} s at index {late[0] + 1}"
            raise JointIdError(f"time_s {fault}: give two times or more, each above the one before.")
        interval = float(np.median(steps))
        set_fields(self, time_s=time, theta_rad=theta, tau_Nm=tau, interval_s=interval)

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.theta_rad.shape[1])

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
        raise JointIdError(
            f"{table.name}: no column is chosen for {listed(mapping.open_roles)}. Choose one of: "
            f"{listed(name for name in table.names if name not in names)}."
        )
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
            f"{table.name}: {counted(kept, 'row')} with all of {listed(names)}.{which} Choose other "
            "columns."
        )
    notes = [*table.notes, clock_note] if clock_note else list(table.notes)
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
