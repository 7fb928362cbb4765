"""Damaged logs of every format: a table or a JointIdError, in bounded time."""

from __future__ import annotations

import json
import random
import sys
import time
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from log_makers import cell_log, comma_log
from log_mutations import KINDS, check, mutated
from random_cases import examples, share, tries

from benchmarks.mutated_logs import outcomes
from jointid import JointIdError
from jointid.importing import (
    Channel,
    JointMapping,
    Mapping,
    TimeColumn,
    apply_mapping,
    find_segments,
    guess_mapping,
    mapping_from_json,
    mapping_to_json,
    read_log,
    read_logs,
)

TRIES = tries(15, long=40, nightly=100)


def tell(capsys: pytest.CaptureFixture[str], text: str) -> None:
    """Print what was tried, also from a worker of pytest-xdist: its standard error is the terminal's."""
    with capsys.disabled():
        print(f"\n[fuzz] {text}", file=sys.__stderr__, flush=True)


@pytest.mark.parametrize("kind", list(KINDS))
def test_damaged_logs_of_every_format(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A sample of ``benchmarks/mutated_logs.py``."""
    began = time.monotonic()
    found = [*outcomes(kind, KINDS[kind](tmp_path), range(TRIES))]
    outcome = Counter(each.said for each in found)
    tell(capsys, f"{kind}: {TRIES} mutations, {dict(outcome)}, {time.monotonic() - began:.1f} s")
    assert outcome.total() == TRIES
    assert outcome.keys() <= {"read", "refused"}
    assert outcome["refused"] > 0


@pytest.mark.parametrize(("kind", "seed"), [("labview.tdms", 3342)], ids=["values of 1e300"])
def test_damaged_logs_that_once_caused_internal_errors(kind: str, seed: int, tmp_path: Path) -> None:
    (outcome,) = outcomes(kind, KINDS[kind](tmp_path), [seed])
    assert outcome.said in ("read", "refused")


def test_damaged_text_logs(capsys: pytest.CaptureFixture[str]) -> None:
    rng = random.Random(3)
    outcome: Counter[str] = Counter()
    samples = [cell_log("utf-16", 60), cell_log(rows=60), comma_log(60)]
    count = share(600)
    for _ in range(count):
        try:
            outcome[check(read_log(mutated(rng.choice(samples), rng), "log.csv"))] += 1
        except JointIdError as error:
            outcome[check(error)] += 1
    tell(capsys, f"text: {count} mutations, {dict(outcome)}")
    assert outcome["refused"] > 0
    assert outcome["read"] > 0


@examples(200, derandomize=True, suppress_health_check=list(HealthCheck))
@given(st.text(alphabet="0123456789.,;\t -+eE\n\"'#abZ°[]%/:", max_size=300))
def test_any_text(content: str) -> None:
    try:
        check(read_log(content.encode(), "log.csv"))
    except JointIdError:
        return


@examples(100, derandomize=True)
@given(st.binary(min_size=1, max_size=200))
def test_any_bytes_that_claim_to_be_text(content: bytes) -> None:
    try:
        check(read_log(b"t;q;tau\n" + content, "log.csv"))
    except JointIdError:
        return


MAPPING = Mapping(
    TimeColumn("t", "ms"),
    (
        JointMapping(Channel("q1", "counts", 4096.0, "joint"), Channel("m1", "%", 8.2), 101.0),
        JointMapping(Channel("q2", "deg"), Channel("m2", "N·m", sign=-1)),
    ),
)
anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=6,
)


@examples(300, derandomize=True)
@given(st.data())
def test_mapping_with_anything_in_one_place(data: st.DataObject) -> None:
    values = json.loads(mapping_to_json(MAPPING))
    place = values
    while True:
        key = data.draw(st.sampled_from(sorted(place) if isinstance(place, dict) else range(len(place))))
        if (
            not isinstance(place[key], dict | list)
            or not place[key]
            or data.draw(st.integers(0, 4)) == 0
        ):
            break
        place = place[key]
    if isinstance(place, dict) and data.draw(st.booleans()):
        del place[key]
    else:
        place[key] = data.draw(anything)
    try:
        assert isinstance(mapping_from_json(json.dumps(values)), Mapping)
    except JointIdError:
        return


@pytest.mark.parametrize("text", ["[" * 5000, '{"format": 1e999}', "NaN", '"x"', "", "{}"])
def test_odd_json_as_mapping(text: str) -> None:
    with pytest.raises(JointIdError):
        mapping_from_json(text)


def test_every_sound_log_of_the_fuzzed_kinds_is_read(tmp_path: Path) -> None:
    """What the mutations start from is itself in order, and goes on to segments."""
    results = list(
        read_logs(
            [
                (make(tmp_path / name), name)
                for name, make in KINDS.items()
                if not (tmp_path / name).mkdir()
            ]
        )
    )
    for result in results:
        assert not isinstance(result, JointIdError), str(result)
        log = apply_mapping(result[0], guess_mapping(result[0]).mapping)
        assert [round(s.frequency_hz, 2) for s in find_segments(log)] == [10.0]
