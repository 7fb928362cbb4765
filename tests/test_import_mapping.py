"""Mapping of columns: units in both directions, sides of the gear, guesses with reasons, JSON."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from log_makers import ANGLE, ROWS, TIME_S, TORQUE, cell_log, comma_log, mat_scope, unsure
from random_cases import examples

from jointid import Inertia, JointIdError
from jointid.importing import (
    Channel,
    Guess,
    JointMapping,
    LogColumn,
    LogTable,
    Mapping,
    TimeColumn,
    apply_mapping,
    find_segments,
    guess_mapping,
    mapping_from_json,
    mapping_to_json,
    read_log,
    study_from_logs,
)
from jointid.importing.columns.log_table import numbers
from jointid.importing.columns.units import (
    ANGLE_UNITS,
    POSITION_SCALES,
    TIME_UNITS,
    TORQUE_SCALES,
    TORQUE_UNITS,
)
from jointid.importing.map.guess import propose_joint
from jointid.importing.map.reasons import assumptions, unchanged


def table_of(**columns: object) -> LogTable:
    """A table by hand; a double underscore parts name and unit."""
    made = []
    for key, values in columns.items():
        name, _, unit = key.partition("__")
        made.append(LogColumn(name, numbers(np.asarray(values, float)), unit))
    return LogTable("log", tuple(made))


def one(position: Channel, torque: Channel, ratio: float = 1.0) -> Mapping:
    return Mapping(TimeColumn("t", "s"), (JointMapping(position, torque, ratio),))


T = np.arange(5) * 0.01
X = np.array([0.0, 1.0, -2.0, 3.0, 0.5])


def mapped(position: Channel, torque: Channel, ratio: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    log = apply_mapping(table_of(t=T, q=X, tau=X), one(position, torque, ratio))
    return log.theta_rad[:, 0], log.tau_Nm[:, 0]


@pytest.mark.parametrize(
    ("unit", "scale", "expected"),
    [
        ("rad", None, 1.0),
        ("mrad", None, 1e-3),
        ("deg", None, np.pi / 180),
        ("rev", None, 2 * np.pi),
        ("counts", 4096.0, 2 * np.pi / 4096),
        ("counts", -4096.0, -2 * np.pi / 4096),
        ("V", 34.18, np.radians(34.18)),
    ],
)
def test_angle_units(unit: str, scale: float | None, expected: float) -> None:
    theta, _ = mapped(Channel("q", unit, scale), Channel("tau", "N·m"))
    np.testing.assert_allclose(theta, expected * X, rtol=1e-15)


@pytest.mark.parametrize(
    ("unit", "scale", "expected"),
    [
        ("N·m", None, 1.0),
        ("mN·m", None, 1e-3),
        ("kN·m", None, 1e3),
        ("A", 0.12, 0.12),
        ("mA", 0.12, 0.12e-3),
        ("%", 8.2, 0.082),
        ("‰", 8.2, 0.0082),
        ("V", -3.0, -3.0),
    ],
)
def test_torque_units(unit: str, scale: float | None, expected: float) -> None:
    _, tau = mapped(Channel("q", "rad"), Channel("tau", unit, scale))
    np.testing.assert_allclose(tau, expected * X, rtol=1e-15)


def test_sides_of_the_gear() -> None:
    """physics.md: θ_motor = n θ_joint and τ_motor = τ_joint / n, so that power is the same."""
    theta, tau = mapped(Channel("q", "rad", side="joint"), Channel("tau", "N·m", side="joint"), -93.5)
    np.testing.assert_allclose(theta, -93.5 * X)
    np.testing.assert_allclose(tau, X / -93.5)
    np.testing.assert_allclose(theta * tau, X * X)
    theta, tau = mapped(Channel("q", "rad", sign=-1), Channel("tau", "N·m", side="motor"), 50.0)
    np.testing.assert_allclose(theta, -X)
    np.testing.assert_allclose(tau, X)


@pytest.mark.parametrize(("unit", "seconds"), [*TIME_UNITS.items()])
def test_time_units(unit: str, seconds: float) -> None:
    mapping = replace(one(Channel("q", "rad"), Channel("tau", "N·m")), time=TimeColumn("t", unit))
    log = apply_mapping(table_of(t=T / seconds + 77, q=X, tau=X), mapping)
    np.testing.assert_allclose(log.time_s, T, atol=1e-7)


def test_sample_numbers_and_numbered_rows() -> None:
    table = table_of(t=[7, 8, 9, 11, 12], q=X, tau=X)
    joints = (JointMapping(Channel("q", "rad"), Channel("tau", "N·m")),)
    counted = apply_mapping(table, Mapping(TimeColumn("t", "samples", 500.0), joints))
    np.testing.assert_allclose(counted.time_s, np.array([0, 1, 2, 4, 5]) / 500)
    numbered = apply_mapping(table, Mapping(TimeColumn("", "samples", 500.0), joints))
    np.testing.assert_allclose(numbered.time_s, np.arange(5) / 500)


channels = {
    "position": (ANGLE_UNITS, POSITION_SCALES),
    "torque": (TORQUE_UNITS, TORQUE_SCALES),
}
scales = st.floats(0.01, 1e5) | st.floats(-1e5, -0.01)


@st.composite
def channel(draw: st.DrawFn, what: str, column: str) -> Channel:
    units, with_scale = channels[what]
    unit = draw(st.sampled_from(list(units)))
    scale = draw(scales) if unit in with_scale else None
    return Channel(
        column, unit, scale, draw(st.sampled_from(["motor", "joint"])), draw(st.sampled_from([1, -1]))
    )


@st.composite
def mappings(draw: st.DrawFn) -> Mapping:
    joints = draw(st.integers(1, 4))
    return Mapping(
        time=draw(
            st.sampled_from(
                [TimeColumn("t", u) for u in TIME_UNITS] + [TimeColumn("", "samples", 125.0)]
            )
        ),
        joints=tuple(
            JointMapping(
                draw(channel("position", f"q{j} µ")), draw(channel("torque", f'τ"{j}')), draw(scales)
            )
            for j in range(joints)
        ),
        torque_hold=draw(st.booleans()),
        torque_delay_s=draw(st.floats(0, 0.01)),
    )


@examples(60, derandomize=True)
@given(mappings())
def test_json_round_trip(mapping: Mapping) -> None:
    assert mapping_from_json(mapping_to_json(mapping)) == mapping


@examples(60, derandomize=True)
@given(mappings(), st.integers(0, 1000))
def test_signals_in_any_unit_and_side_are_converted_back_exactly(mapping: Mapping, seed: int) -> None:
    """Motor-side signals written in any units, on any side, come back as they were."""
    rng = np.random.default_rng(seed)
    n = mapping.n
    theta, tau = rng.uniform(-1, 1, (2, 20, n))
    seconds = np.arange(20) * 0.008
    unit = mapping.time
    clock = [] if not unit.column else [LogColumn("t", numbers(seconds / TIME_UNITS[unit.unit]))]
    for j, joint in enumerate(mapping.joints):
        for written, values in ((joint.position, theta[:, j]), (joint.torque, tau[:, j])):
            angle = written is joint.position
            shown = values * written.sign
            if written.side == "joint":
                shown = shown / joint.gear_ratio if angle else shown * joint.gear_ratio
            shown = shown / (ANGLE_UNITS if angle else TORQUE_UNITS)[written.unit]
            if written.scale is not None:
                shown = shown * written.scale if written.unit == "counts" else shown / written.scale
            clock.append(LogColumn(written.column, numbers(shown)))
    log = apply_mapping(LogTable("log", tuple(clock)), mapping)
    np.testing.assert_allclose(log.theta_rad, theta, rtol=1e-12)
    np.testing.assert_allclose(log.tau_Nm, tau, rtol=1e-12)
    np.testing.assert_allclose(log.time_s, seconds, atol=1e-12)


def test_rows_without_a_value_are_left_out_with_a_note() -> None:
    q = X.copy()
    q[2] = np.nan
    log = apply_mapping(table_of(t=T, q=q, tau=X), one(Channel("q", "rad"), Channel("tau", "N·m")))
    assert log.time_s.size == 4
    assert "1 of 5 rows" in log.notes[0]
    assert "row 3" in log.notes[0]


@pytest.mark.parametrize(
    ("time", "said"),
    [
        ([0, 1, 2, 2, 3], 'row 4, column "t": 2 s repeats 2 s'),
        ([0, 1, 2, 1, 3], 'row 4, column "t": 1 s goes back from 2 s'),
        ([0, 0, 0, 1, 1], "coarser than the samples"),
        ([0, np.nan, np.nan, np.nan, np.nan], "1 row"),
    ],
)
def test_impossible_times_are_refused(time: list[float], said: str) -> None:
    with pytest.raises(JointIdError, match=said):
        apply_mapping(table_of(t=time, q=X, tau=X), one(Channel("q", "rad"), Channel("tau", "N·m")))


def test_missing_column_names_the_nearest() -> None:
    mapping = one(Channel("positon", "rad"), Channel("tau", "N·m"))
    with pytest.raises(JointIdError, match='Did you mean "position"'):
        apply_mapping(table_of(t=T, position=X, tau=X), mapping)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: TimeColumn("t", "h"), "expected one of s, ms"),
        (lambda: TimeColumn("t", "samples"), "need a rate"),
        (lambda: TimeColumn("t", "samples", -5.0), "must be positive"),
        (lambda: TimeColumn("t", "ms", 5.0), 'goes with the unit "samples"'),
        (lambda: TimeColumn(""), "no column"),
        (lambda: one(Channel("q", "counts"), Channel("tau", "N·m")), "needs a scale: counts per turn"),
        (lambda: one(Channel("q", "rad"), Channel("tau", "%")), "needs a scale: rated torque"),
        (lambda: one(Channel("q", "rad", 2.0), Channel("tau", "N·m")), "takes no scale"),
        (lambda: one(Channel("q", "counts", 0.0), Channel("tau", "N·m")), "counts per turn is 0"),
        (lambda: one(Channel("q", "N·m"), Channel("tau", "N·m")), "unit = 'N·m'; expected one of rad"),
        (
            lambda: one(Channel("q", "rad", side="arm"), Channel("tau", "N·m")),
            "expected one of motor, joint",
        ),
        (lambda: one(Channel("q", "rad", sign=2), Channel("tau", "N·m")), "expected 1 or -1"),
        (lambda: one(Channel("q", "rad"), Channel("tau", "N·m"), 0.0), "gear_ratio = 0"),
        (
            lambda: one(Channel("q", "rad"), Channel("q", "N·m")),
            "is both position of joint 1 and torque",
        ),
        (lambda: one(Channel("t", "rad"), Channel("q", "N·m")), "is both time and position"),
        (lambda: Mapping(TimeColumn("t"), ()), "has no joints"),
    ],
)
def test_invalid_mappings_are_refused(make: object, said: str) -> None:
    with pytest.raises(JointIdError, match=said):
        make()  # type: ignore[operator]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"format": 2}, "reads format 1"),
        ({"joints": 3}, "expected a list"),
        ({"joint": []}, 'unknown key "joint". Did you mean "joints"'),
        ({"time": {"column": "t", "unit": 3}}, "unit = 3"),
        ({"time": None}, "time is missing"),
        ({"time": 3}, "time: expected keys"),
        (
            {"joints": [{"position": {"column": "q"}, "torque": {}}]},
            "position of joint 1: unit is missing",
        ),
        ({"torque_hold": 1}, "expected true or false"),
    ],
)
def test_json_without_a_mapping_is_refused(change: dict[str, object], said: str) -> None:
    values = json.loads(mapping_to_json(one(Channel("q", "rad"), Channel("tau", "N·m")))) | change
    with pytest.raises(JointIdError, match=said):
        mapping_from_json(json.dumps(values))


# --- guesses


def guessed(*names: str, **made: object) -> Mapping:
    """Guess from a header; the first column is time, the others sines."""
    rows = [
        ",".join(f"{value:.6f}" for value in (0.004 * k, *np.sin(0.3 * k + np.arange(len(names) - 1))))
        for k in range(50)
    ]
    (table,) = read_log("\n".join([",".join(names), *rows]).encode(), "log.csv")
    return guess_mapping(table).mapping


@pytest.mark.parametrize(
    ("names", "pairs"),
    [
        (("time", "q1", "q2", "tau1", "tau2"), [("q1", "tau1"), ("q2", "tau2")]),
        (("t", "tau_2", "q_2", "tau_1", "q_1"), [("q_1", "tau_1"), ("q_2", "tau_2")]),
        (
            ("Zeit [s]", "Winkel A1 [°]", "Drehmoment A1 [Nm]", "Winkel A2 [°]", "Drehmoment A2 [Nm]"),
            [("Winkel A1", "Drehmoment A1"), ("Winkel A2", "Drehmoment A2")],
        ),
        (
            ("timestamp", "CmdPos_A1", "ActPos_A1", "ActVel_A1", "ActTorque_A1"),
            [("ActPos_A1", "ActTorque_A1")],
        ),
        (
            ("t", "Sollposition", "Istposition", "Schleppfehler", "Iststrom [A]", "Drehzahl [1/min]"),
            [("Istposition", "Iststrom")],
        ),
        (
            (
                "Temps [s]",
                "angle axe 1 [deg]",
                "couple axe 1 [Nm]",
                "angle axe 2 [deg]",
                "couple axe 2 [Nm]",
            ),
            [("angle axe 1", "couple axe 1"), ("angle axe 2", "couple axe 2")],
        ),
        (("tempo", "posizione", "coppia [Nm]", "velocità"), [("posizione", "coppia")]),
        (("tiempo", "velocidad", "posición", "par motor [Nm]"), [("posición", "par motor")]),
        (
            (
                "time",
                "shoulder position",
                "shoulder velocity",
                "shoulder effort",
                "elbow position",
                "elbow effort",
            ),
            [("shoulder position", "shoulder effort"), ("elbow position", "elbow effort")],
        ),
        (
            (
                "t",
                "position",
                "velocity",
                "effort",
                "position_command",
                "effort_command",
                "motor_current",
            ),
            [("position", "effort")],
        ),
        (("t", "θ1 [rad]", "τ1 [N·m]"), [("θ1", "τ1")]),
        (("time_s", "theta_m1_rad", "tau_m1_Nm"), [("theta_m1", "tau_m1")]),
        (
            ("t", "q10", "q2", "tau10", "tau2"),
            [("q2", "tau2"), ("q10", "tau10")],
        ),
    ],
)
def test_names_in_several_languages(names: tuple[str, ...], pairs: list[tuple[str, str]]) -> None:
    mapping = guessed(*names)
    assert [(j.position.column, j.torque.column) for j in mapping.joints] == pairs


def test_guess_of_the_cell() -> None:
    """Units are read off, sides follow from them; ratios and rated torques are asked for."""
    (table,) = read_log(cell_log(), "cell.csv")
    guess = guess_mapping(table)
    assert guess.mapping.time == TimeColumn("Zeit", "ms")
    first, second = guess.mapping.joints
    assert first.position == Channel("Achse 1 Ist", "deg", None, "joint")
    assert second.torque == Channel("Moment 2", "%", 1.0, "motor")
    asked = {reason.what for reason in unsure(guess)}
    assert {"gear ratio of joint 1", "scale of torque of joint 2", "torque hold"} <= asked
    assert "position of joint 1" not in asked
    assert "unit of time" not in asked
    assert all(reason.text.endswith(".") for reason in guess.reasons)


def test_a_position_without_a_torque_is_reported() -> None:
    names = ("Zeit", "Achse 1 Ist", "Achse 2 Ist", "Moment 1", "Moment 2")
    columns = {
        f"{name}__{unit}": T for name, unit in zip(names, ("ms", "deg", "deg", "%", "%"), strict=True)
    }
    whole = guess_mapping(table_of(**columns))
    assert "joints" not in {reason.what for reason in whole.reasons}
    for gone, said in (
        ("Moment 2__%", '"Achse 2 Ist" has no matching torque'),
        ("Achse 1 Ist__deg", '"Moment 1" has no matching position'),
    ):
        part = guess_mapping(table_of(**{key: v for key, v in columns.items() if key != gone}))
        assert part.mapping.n == 1
        (reason,) = [r for r in unsure(part) if r.what == "joints"]
        assert said in reason.text


def test_an_added_joint_takes_unused_columns_but_never_the_time() -> None:
    table = table_of(Zeit__ms=T, q1=X, tau1=X, speed=X, tau9=X, q9=X)
    like = Channel("q1", "deg", None, "joint"), Channel("tau1", "%", 5.0, "joint")
    joint, why = propose_joint(table, 2, like, {"Zeit", "q1", "tau1"})
    assert joint.position == Channel("q9", "deg", None, "joint")
    assert joint.torque == Channel("tau9", "%", 1.0, "joint")
    assert {
        f"{role} of joint 2" for role in ("position", "torque", "scale of torque", "gear ratio")
    } <= {reason.what for reason in why if not reason.sure}
    joint, _ = propose_joint(table, 3, like, {"Zeit", "q1", "tau1", "speed", "tau9"})
    assert (joint.position.column, joint.torque.column) == ("q9", "")


def test_guess_of_unnamed_signals_is_marked_as_a_proposal() -> None:
    (table,) = read_log(mat_scope(), "scope.mat")
    guess = guess_mapping(table)
    assert guess.mapping.time == TimeColumn("time", "s")
    assert {"position of joint 1", "torque of joint 1"} <= {r.what for r in unsure(guess)}


@pytest.mark.parametrize(
    ("step", "unit"), [(0.001, "s"), (0.05, "s"), (1.0, "ms"), (4.0, "ms"), (250.0, "µs"), (1e6, "ns")]
)
def test_unit_of_time_by_its_steps(step: float, unit: str) -> None:
    table = table_of(time=step * np.arange(50) * 1.0, q=ANGLE[:50], tau=TORQUE[:50])
    assert guess_mapping(table).mapping.time.unit == unit


def test_sample_numbers_and_no_time_at_all() -> None:
    counted = guess_mapping(table_of(nr=np.arange(50), q=ANGLE[:50], tau=TORQUE[:50]))
    assert counted.mapping.time == TimeColumn("nr", "samples", 1000.0)
    none = guess_mapping(table_of(q=ANGLE[:50], tau=TORQUE[:50]))
    assert none.mapping.time == TimeColumn("", "samples", 1000.0)
    assert "time" in {reason.what for reason in unsure(none)}


def test_encoder_counts_are_recognised() -> None:
    table = table_of(t=TIME_S, encoder=np.round(65536 * ANGLE), torque=TORQUE)
    joint = guess_mapping(table).mapping.joints[0]
    assert joint.position == Channel("encoder", "counts", 1.0)


def test_table_without_two_signals_has_an_open_role_that_is_named() -> None:
    table = table_of(t=TIME_S, q=ANGLE)
    guess = guess_mapping(table)
    assert guess.mapping.open_roles == ("torque of joint 1",)
    assert any("a log needs at least two" in reason.text for reason in unsure(guess))
    with pytest.raises(JointIdError, match="no column is chosen for torque of joint 1"):
        apply_mapping(table, guess.mapping)


def test_from_bytes_to_a_study_by_mapping_alone() -> None:
    (table,) = read_log(comma_log(), "run.csv")
    guess = guess_mapping(table)
    log = apply_mapping(table, guess.mapping)
    assert log.time_s.size == ROWS
    study = study_from_logs(log, find_segments(log), Inertia(0.002, 0.004))
    (record,) = study.records
    assert abs(record.frequency_hz - 10) < 1e-3


# --- times as loggers write them


def sines(rows: int = 400, step: float = 0.002) -> dict[str, np.ndarray]:
    """A table whose rows all differ, at 500 Hz."""
    t = np.arange(rows) * step
    return {"t": t, "q": np.sin(9 * t) + t, "tau": np.cos(9 * t) - t}


def test_rows_written_twice_are_left_out_with_their_numbers() -> None:
    """A buffer written twice gives the original log, and its time column is found."""
    whole = sines()
    for again in (slice(90, 100), slice(120, 121)):
        order = np.concatenate([np.arange(again.stop), np.arange(again.start, 400)])
        table = table_of(**{name: values[order] for name, values in whole.items()})
        guess = guess_mapping(table).mapping
        assert guess.time == TimeColumn("t", "s")
        log = apply_mapping(table, guess)
        np.testing.assert_array_equal(log.time_s, whole["t"])
        np.testing.assert_array_equal(log.theta_rad[:, 0], whole["q"])
        assert f"row {again.stop + 1}" in log.notes[0]


def test_copies_of_every_row() -> None:
    whole = sines()
    table = table_of(**{name: np.repeat(values, 2) for name, values in whole.items()})
    np.testing.assert_array_equal(apply_mapping(table, guess_mapping(table).mapping).time_s, whole["t"])


def test_few_repeated_times_with_other_values_are_left_out_and_many_refused() -> None:
    whole = sines()
    whole["t"][200] = whole["t"][199]
    log = apply_mapping(table_of(**whole), one(Channel("q", "rad"), Channel("tau", "N·m")))
    assert log.time_s.size == 399
    assert "1 row that repeat the time" in log.notes[0]
    assert "row 201" in log.notes[0]
    whole["t"][100:120:2] = whole["t"][99:119:2]
    with pytest.raises(JointIdError, match=r'row 101, column "t": 0\.198 s repeats'):
        apply_mapping(table_of(**whole), one(Channel("q", "rad"), Channel("tau", "N·m")))


def test_other_rows_at_an_earlier_time_are_refused_with_their_row() -> None:
    whole = sines()
    whole["t"][250:] -= 0.1
    table = table_of(**whole)
    assert guess_mapping(table).mapping.time.column == "t"
    with pytest.raises(JointIdError, match=r'row 251, column "t": 0\.4 s goes back from 0\.498 s'):
        apply_mapping(table, guess_mapping(table).mapping)


@pytest.mark.parametrize(
    ("unit", "step", "turn", "start"),
    [("ms", 2.0, 2.0**16, 65000.0), ("ms", 1.0, 2.0**8, 0.0), ("s", 0.004, 86400.0, 86399.5)],
)
def test_a_clock_that_restarts_is_continued(unit: str, step: float, turn: float, start: float) -> None:
    time = start + step * np.arange(400)
    values = {"q": np.sin(time), "tau": np.cos(time)}
    table = table_of(**{f"time__{unit}": time % turn}, **values)
    guess = guess_mapping(table).mapping
    assert guess.time == TimeColumn("time", unit)
    log = apply_mapping(table, guess)
    np.testing.assert_allclose(log.time_s, (time - start) * TIME_UNITS[unit], atol=1e-9)
    assert "restarts" in log.notes[0]


def test_gaps_are_reported_and_split_the_log() -> None:
    whole = {name: np.delete(values, slice(200, 300)) for name, values in sines().items()}
    log = apply_mapping(table_of(**whole), guess_mapping(table_of(**whole)).mapping)
    assert "A gap of 0.202 s, before row 201" in log.notes[0]
    assert "from 0.398 to 0.6 s" in log.notes[0]
    assert not any(s.start_s < 0.4 and s.stop_s > 0.6 for s in find_segments(log))


def test_one_gap_for_notes_and_for_segments() -> None:
    from jointid.importing.find import segments
    from jointid.importing.map import sample_times

    assert sample_times.GAP == segments.GAP


def test_an_assumed_sample_rate_is_reported() -> None:
    table = table_of(q=X, tau=X)
    log = apply_mapping(table, guess_mapping(table).mapping)
    assert "numbered at 1000 Hz; the log does not state this rate" in log.notes[0]


def test_a_constant_time_is_named() -> None:
    whole = sines()
    whole["t"] = np.full(400, 1.77e9)
    guess = guess_mapping(table_of(**whole))
    (reason,) = [r for r in guess.reasons if r.what == "time"]
    assert 'name of "t" indicates time, but it does not increase' in reason.text
    assert not reason.sure


@pytest.mark.parametrize(
    ("name", "unit", "side"),
    [
        ("tau1 joint", "N·m", "joint"),
        ("joint torque 1", "N·m", "joint"),
        ("link_torque_1", "N·m", "joint"),
        ("Abtriebsmoment 1 lastseitig", "N·m", "joint"),
        ("Gelenkmoment 1", "N·m", "joint"),
        ("motor torque joint 1", "N·m", "motor"),
        ("joint 1 current", "A", "motor"),
        ("axis1 torque", "‰", "motor"),
        ("Drehmoment Achse 1", "N·m", "motor"),
        ("tau1", "N·m", "motor"),
    ],
)
def test_side_of_a_torque_by_its_name(name: str, unit: str, side: str) -> None:
    whole = sines()
    columns = (
        LogColumn("t", numbers(whole["t"]), "s"),
        LogColumn("q1", numbers(whole["q"]), "rad"),
        LogColumn(name, numbers(whole["tau"]), unit),
    )
    guess = guess_mapping(LogTable("log", columns))
    torque = guess.mapping.joints[0].torque
    assert (torque.column, torque.side) == (name, side)
    said = {r.what: r for r in guess.reasons}
    assert ("does not state the side" in said["side of torque of joint 1"].text) == (
        name in ("tau1", "Drehmoment Achse 1")
    )
    assert ("gear ratio of joint 1" in said) == (side == "joint")


# --- encoders of one turn


@pytest.mark.parametrize(
    ("unit", "scale", "turn"),
    [
        ("rad", None, 2 * np.pi),
        ("mrad", None, 2000 * np.pi),
        ("deg", None, 360.0),
        ("rev", None, 1.0),
        ("counts", 4096.0, 4096.0),
        ("counts", -20000.0, 20000.0),
        ("counts", 1000.0, 65536.0),
    ],
)
@pytest.mark.parametrize("low", [0.0, -0.5])
@pytest.mark.parametrize("seed", [1, 2])
def test_jumps_of_one_turn_are_unwrapped(
    unit: str, scale: float | None, turn: float, low: float, seed: int
) -> None:
    """A motion of a few turns, and one back and forth over the edge, differ by whole turns at most."""
    rng = np.random.default_rng(seed)
    t = np.arange(3000) * 1e-3
    for motion in (
        1.5 * np.sin(9 * t) + 0.9,
        0.02 * np.sin(40 * t) + low,
        0.7 * t + 0.02 * np.sin(90 * t),
    ):
        true = turn * (motion + rng.normal(0, 1e-4, t.size))
        true = np.round(true) if unit == "counts" else true
        seen = np.mod(true - low * turn, turn) + low * turn
        channel = Channel("q", unit, scale)
        log = apply_mapping(table_of(t=t, q=seen, tau=np.cos(t)), one(channel, Channel("tau", "N·m")))
        per_unit = JointMapping(channel, Channel("tau", "N·m")).rad_per_unit
        expected = (true - true[0] + seen[0]) * per_unit
        np.testing.assert_allclose(log.theta_rad[:, 0], expected, atol=1e-9 * abs(turn * per_unit))
        assert "the jumps are removed" in log.notes[-1]


@pytest.mark.parametrize(
    "values",
    [
        6.0 * np.sin(np.arange(500) / 30),  # a large motion, without a jump
        np.where(np.arange(500) % 100 < 50, 0.0, 5.0) + 0.001 * np.sin(np.arange(500)),  # 0.8 turns
        8 * np.sin(np.arange(500) / 20) + 6.28 * (np.arange(500) == 300),  # more than a turn, an outlier
        np.zeros(500),
    ],
)
def test_other_jumps_are_not_unwrapped(values: np.ndarray) -> None:
    table = table_of(t=np.arange(500) * 1e-3, q=values, tau=np.cos(np.arange(500)))
    log = apply_mapping(table, one(Channel("q", "rad"), Channel("tau", "N·m")))
    np.testing.assert_array_equal(log.theta_rad[:, 0], values)
    assert log.notes == ()


def test_a_guess_reports_a_single_turn_encoder() -> None:
    t = np.arange(500) * 1e-3
    guess = guess_mapping(table_of(t=t, q__deg=np.mod(400 * np.sin(9 * t), 360), tau=np.cos(t)))
    said = {r.what: r.text for r in guess.reasons}
    assert "360 deg" in said["wrap-around of position of joint 1"]


# --- pairs of columns


def pairs_of(table: LogTable) -> list[tuple[str, str]]:
    return [(j.position.column, j.torque.column) for j in guess_mapping(table).mapping.joints]


@pytest.mark.parametrize(
    ("positions", "torques"),
    [
        (("enc_1", "enc_2"), ("i_1", "i_2")),
        (("inc1", "inc2"), ("I1", "I2")),
        (("Encoder A1", "Encoder A2"), ("Strom A1", "Strom A2")),
        (("pos1", "pos2"), ("eff1", "eff2")),
        (("Ist 1", "Ist 2"), ("Mom. 1", "Mom. 2")),
        (("Winkel J1", "Winkel J2"), ("Drehmoment 1", "Drehmoment 2")),
        (("q1", "q2"), ("trq axis1", "trq axis2")),
        (("Pos 1", "Pos 1"), ("Moment 1", "Moment 2")),
        (("Pos 1", "Pos 2"), ("Moment", "Moment")),
        (("Axis 2.ActPos", "Axis 3.ActPos"), ("Drive 4.Torque", "Drive 5.Torque")),
    ],
)
def test_columns_are_paired_by_words_and_numbers(
    positions: tuple[str, str], torques: tuple[str, str]
) -> None:
    rng = np.random.default_rng(3)
    names = ["Zeit", *positions, *torques]
    columns = [LogColumn(name, numbers(rng.normal(size=50))) for name in names]
    columns[0] = LogColumn("Zeit", numbers(np.arange(50) * 0.001), "s")
    table = LogTable("log", tuple(columns))
    if torques == ("Moment", "Moment"):  # only the repetition tells the second
        assert ("Pos 2", "Moment (2)") in pairs_of(table)
    else:
        assert pairs_of(table) == [*zip(table.names[1:3], table.names[3:5], strict=True)]


def test_a_pair_by_number_alone_must_be_confirmed() -> None:
    names = ("t", "Pos 1", "Pos 1", "Moment 1", "Moment 2")
    values = np.arange(50) * 0.001
    table = LogTable(
        "log", tuple(LogColumn(n, numbers(values if n == "t" else np.sin(values))) for n in names)
    )
    asked = {r.what: r.text for r in unsure(guess_mapping(table))}
    assert "by its number alone" in asked["position of joint 2"]
    assert "position of joint 1" not in asked


def test_pairs_by_order_must_be_confirmed_and_numbers_with_gaps_make_none() -> None:
    t = np.arange(50) * 0.001

    def guessed(*names: str) -> Guess:
        columns = [LogColumn(n, numbers(np.sin(t * k))) for k, n in enumerate(names, start=1)]
        return guess_mapping(LogTable("log", (LogColumn("t", numbers(t)), *columns)))

    by_order = guessed("Axis 2.ActPos", "Axis 3.ActPos", "Drive 4.Torque", "Drive 5.Torque")
    asked = {r.what: r.text for r in unsure(by_order)}
    assert all("the order of the numbers" in asked[f"torque of joint {k}"] for k in (1, 2))
    for torques in (
        ("Axis 2 torque", "Axis 3 torque"),
        ("Axis 3 torque", "Axis 4 torque"),
        ("Drive 2 torque", "Drive 3 torque"),
    ):  # the same words, or a number in common
        other = guessed("Axis 1 position", "Axis 2 position", *torques)
        assert "the order" not in " ".join(r.text for r in other.reasons)
    with_gap = guessed("Axis 2.ActPos", "Axis 3.ActPos", "Drive 4.Torque", "Drive 6.Torque")
    assert "the order" not in " ".join(r.text for r in with_gap.reasons)
    (left,) = (r.text for r in with_gap.reasons if r.what == "joints")
    assert "Axis" in left
    assert "Drive" in left


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("layout", ["blocks", "torques first", "by joint", "by joint, torque first"])
@pytest.mark.parametrize("timed", [True, False])
def test_columns_without_names_are_recognised_by_their_signals(n: int, layout: str, timed: bool) -> None:
    """Torques of a swept motion are rougher than its positions, in any order of the columns."""
    rng = np.random.default_rng(n)
    t = np.arange(4000) * 1e-3
    phase = 2 * np.pi * (1.0 + 2.0 * t) * t
    q = [(0.3 + 0.1 * k) / (1 + t) ** 2 * np.sin(phase + k) for k in range(n)]
    tau = [np.gradient(np.gradient(x, t), t) * 1e-2 + rng.normal(0, 1e-3, t.size) for x in q]
    if layout.startswith("by joint"):
        pairs = [(x, y) if "first" not in layout else (y, x) for x, y in zip(q, tau, strict=True)]
        signals = [s for pair in pairs for s in pair]
    else:
        signals = [*q, *tau] if layout == "blocks" else [*tau, *q]
    values = [t, *signals] if timed else signals
    table = LogTable("log", tuple(LogColumn("", numbers(v)) for v in values))
    guess = guess_mapping(table)
    assert guess.mapping.time.column == ("column 1" if timed else "")
    assert guess.mapping.n == n
    for joint, x, y in zip(guess.mapping.joints, q, tau, strict=True):
        np.testing.assert_array_equal(table.column(joint.position.column).values, x)
        np.testing.assert_array_equal(table.column(joint.torque.column).values, y)
    assert not any(r.sure for r in guess.reasons if r.what.startswith(("position of", "torque of")))


def test_a_name_that_is_only_a_unit_of_time() -> None:
    table = table_of(ms=2.0 * np.arange(50), q=ANGLE[:50], tau=TORQUE[:50])
    assert guess_mapping(table).mapping.time == TimeColumn("ms", "ms")


def test_huge_numbers_of_damaged_files_do_not_stop_the_guess() -> None:
    huge = np.where(np.arange(50) % 2, 1e307, -1e307)
    table = LogTable("log", tuple(LogColumn("", numbers(v)) for v in (huge, np.sin(np.arange(50)))))
    assert guess_mapping(table).mapping.n == 1


class TestAssumptions:
    """What a log cannot prove, by the names of the mapping's entries."""

    @pytest.fixture
    def mapping(self) -> Mapping:
        (table,) = read_log(cell_log(), "cell.csv")
        return guess_mapping(table).mapping

    def test_a_guess_lists_all_assumptions(self, mapping: Mapping) -> None:
        assert assumptions(mapping) == (
            "position measured at the joint (joints 1 and 2)",
            "direction of position as logged (joints 1 and 2)",
            "direction of torque as logged (joints 1 and 2)",
            "gear ratio 1 (joints 1 and 2)",
            "rated torque 1 N·m (joints 1 and 2)",
            "torque not held between samples",
        )

    def test_corrected_entries_are_no_assumptions(self, mapping: Mapping) -> None:
        first, second = mapping.joints
        joints = (replace(first, gear_ratio=101.0), second)
        corrected = replace(mapping, joints=joints, torque_hold=True)
        left = set(mapping.assumed) - set(unchanged(corrected, mapping))
        assert left == {"gear ratio of joint 1", "torque hold"}

    def test_assumptions_are_saved_in_a_file(self, mapping: Mapping) -> None:
        again = mapping_from_json(mapping_to_json(mapping))
        assert again == mapping
        assert again.assumed == mapping.assumed

    def test_missing_entries_give_no_assumption(self, mapping: Mapping) -> None:
        names = ("gear ratio of joint 7", "colour of joint 1", "side of spindle of joint 1", "weather")
        assert assumptions(replace(mapping, assumed=names)) == ()


def test_a_sensor_behind_the_gear_with_times_of_its_own_is_unwrapped() -> None:
    time = np.arange(2000) * 1e-3
    angle = 5 * np.sin(20 * time)
    own = np.arange(2000) % 2 == 1
    columns = (
        LogColumn("t", numbers(time), "s"),
        LogColumn("q", numbers(np.where(own, np.nan, angle)), "rad"),
        LogColumn("tau", numbers(np.where(own, np.nan, angle)), "N·m"),
        LogColumn("arm", numbers(np.where(own, angle % 360, np.nan)), "deg"),
    )
    joint = JointMapping(Channel("q", "rad"), Channel("tau", "N·m"), arm=Channel("arm", "deg"))
    log = apply_mapping(LogTable("log", columns), Mapping(TimeColumn("t", "s"), (joint,)))
    assert log.arm_rad is not None
    moved = np.degrees(log.arm_rad[:, 0])
    assert moved - moved[0] == pytest.approx(log.theta_rad[:, 0] - log.theta_rad[0, 0], abs=1e-4)
