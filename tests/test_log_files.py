"""Logs as controllers write them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jointid import JointIdError
from jointid.log_files import MAX_LOG_BYTES, read_log

ROWS = np.array([[0.0, -0.25, 1.5], [0.01, 0.5, -2.5e-3], [0.02, 1e3, 7.0]])


def written(separator: str, decimal: str, comments: str = "", end: str = "\n") -> str:
    def cell(value: float) -> str:
        return repr(float(value)).replace(".", decimal)

    lines = [separator.join(cell(v) for v in row) for row in ROWS]
    return comments + end.join([separator.join(["t", "pos", "Moment [%]"]), *lines, ""])


@pytest.mark.parametrize(
    ("separator", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), ("|", ".")]
)
@pytest.mark.parametrize("comments", ["", "Rob 1 / run 2\nsampled; 1,0 ms\n\n"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_separator_decimal_mark_and_comments_are_found(
    separator: str, decimal: str, comments: str, end: str
) -> None:
    log = read_log("x.csv", written(separator, decimal, comments, end).encode())
    assert list(log) == ["t", "pos", "Moment [%]"]
    np.testing.assert_array_equal(np.column_stack(list(log.values())), ROWS)


def test_latin_1_and_a_byte_order_mark_are_read() -> None:
    assert "Achse [°]" in read_log("x", "t;Achse [°]\n0;1\n1;2\n".encode("latin-1"))
    assert "t" in read_log("x", b"\xef\xbb\xbft,a\n0,1\n1,2\n")


def test_text_columns_are_left_out_and_gaps_are_nan() -> None:
    log = read_log("x", b"t,state,a\n0,run,1\n1,run,\n2,stop,3\n")
    assert list(log) == ["t", "a"]
    np.testing.assert_array_equal(log["a"], [1, np.nan, 3])


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "empty"),
        (b" \n\n ", "empty"),
        (b"hello", "not a table"),
        (b"1,2\n3,4\n", "header"),
        (b"a,b\nx,y\n", "0 column"),
        (b"\x00\x01\x02", "binary"),
        (b"a,b,c\n1,2,3\n1,2,3,4,5\n1,2,3\n1,2,3\n", "line 3"),
        (b"\n" * 500 + b"a,b\n1,2\n", "blank lines"),
    ],
)
def test_what_is_no_log_is_said(data: bytes, said: str) -> None:
    with pytest.raises(JointIdError, match=said) as caught:
        read_log("bad.csv", data)
    assert "bad.csv" in str(caught.value)


def test_a_huge_file_is_refused_before_it_is_read() -> None:
    with pytest.raises(JointIdError, match="more than the limit"):
        read_log("big.csv", b"1" * (MAX_LOG_BYTES + 1))


@settings(derandomize=True, max_examples=200, deadline=None)
@given(st.binary(max_size=300) | st.text(alphabet="01.,;\t\n\"'ab-eE|", max_size=200).map(str.encode))
def test_any_bytes_are_read_or_refused_in_words(data: bytes) -> None:
    try:
        log = read_log("any", data)
    except JointIdError:
        return
    assert len({column.size for column in log.values()}) == 1
