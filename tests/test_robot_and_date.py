"""The optional keys robot and date of a study: exact on disk, and None if not stated."""

from __future__ import annotations

import datetime
import io
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jointid import Inertia, JointIdError, SineRecord, Study, load_study
from jointid.files.digest import study_digest
from jointid.files.study_files import pack_study

TIME = np.arange(200) / 200.0
WAVE = ((np.arange(200) % 40 - 20) / 16)[:, None]  # exact on every machine
PLAIN = Study((SineRecord(5.0, TIME, WAVE, -WAVE),), Inertia([0.0025], [[0.0041]]), name="cell")

offsets = st.integers(-1439, 1439).map(lambda m: datetime.timezone(datetime.timedelta(minutes=m)))
dates = st.none() | st.dates() | st.datetimes(timezones=st.none() | offsets)
texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)


def with_head(text: str) -> bytes:
    """The study's zip with a line more in study.toml."""
    old, new = zipfile.ZipFile(io.BytesIO(pack_study(PLAIN))), io.BytesIO()
    with zipfile.ZipFile(new, "w") as archive:
        for name in old.namelist():
            archive.writestr(name, (text.encode() if name == "study.toml" else b"") + old.read(name))
    return new.getvalue()


@given(robot=texts, date=dates)
def test_the_round_trip_is_exact(robot: str, date: datetime.date | None) -> None:
    study = replace(PLAIN, robot=robot, date=date)
    again = load_study(pack_study(study))
    assert (again.robot, again.date, type(again.date)) == (robot, date, type(date))
    if isinstance(date, datetime.datetime):
        assert again.date.utcoffset() == date.utcoffset()
    assert study_digest(again) == study_digest(load_study(pack_study(study)))


def test_without_robot_and_date_both_are_none() -> None:
    study = load_study(pack_study(PLAIN))
    assert (study.robot, study.date) == ("", None)
    text = zipfile.ZipFile(io.BytesIO(pack_study(PLAIN))).read("study.toml")
    assert b"robot" not in text
    assert b"date" not in text


def test_robot_and_date_are_read_in_common_spellings() -> None:
    study = load_study(with_head('robot = "cell 7, robot A"\ndate = 2026-11-20\n'))
    assert (study.robot, study.date) == ("cell 7, robot A", datetime.date(2026, 11, 20))
    late = load_study(with_head("date = 2026-11-20T13:05:00+01:00\n")).date
    assert late == datetime.datetime(2026, 11, 20, 12, 5, tzinfo=datetime.UTC)


@pytest.mark.parametrize(
    ("line", "parts"),
    [
        ('date = "2026-11-20"', ["study.toml: date must be a date without quotes", "2026-11-20"]),
        ("date = 10:30:00", ["date must be a date", "'10:30:00'", "Example: date = 2026-11-20"]),
        ("date = 2026", ["date must be a date", "2026"]),
        ("date = 2026-13-01", ["study.toml is not valid TOML"]),
        ("robot = 7", ["study.toml: robot must be text in quotes; got 7"]),
        ("robto = 'A'", ['Did you mean "robot"']),
    ],
)
def test_an_invalid_robot_or_date_is_refused(line: str, parts: list[str]) -> None:
    with pytest.raises(JointIdError) as error:
        load_study(with_head(line + "\n"))
    assert all(part in str(error.value) for part in parts), error.value


def test_the_constructor_refuses_an_invalid_robot_or_date() -> None:
    with pytest.raises(JointIdError, match="robot = 7"):
        replace(PLAIN, robot=7)
    with pytest.raises(JointIdError, match="date = '2026-11-20'"):
        replace(PLAIN, date="2026-11-20")
    odd = datetime.timezone(datetime.timedelta(seconds=3208))
    with pytest.raises(JointIdError, match="whole minutes"):
        replace(PLAIN, date=datetime.datetime(1890, 1, 1, tzinfo=odd))


def test_robot_and_date_change_the_digest_and_without_them_it_is_unchanged() -> None:
    day = datetime.date(2026, 11, 20)
    midnight = datetime.datetime(2026, 11, 20)
    studies = [
        PLAIN,
        replace(PLAIN, robot="A"),
        replace(PLAIN, name="cellA"),
        replace(PLAIN, date=day),
        replace(PLAIN, date=midnight),
        replace(PLAIN, robot="A", date=day),
    ]
    assert len({study_digest(study) for study in studies}) == len(studies)
    assert study_digest(PLAIN) == "8e1b7e8d707284db48aedce76ae9d94b"
