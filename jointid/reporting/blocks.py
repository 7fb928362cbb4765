"""Contents of a report as plain values, for HTML and PDF."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from jointid.reporting.drawing import Drawing
from jointid.verdict.findings import Finding


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of text."""

    text: str
    kind: Literal["plain", "lead", "quiet"] = "plain"


@dataclass(frozen=True)
class Table:
    """A table of texts."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    align: str = ""
    """One letter per column, l or r; by default the first column is left-aligned, the others right."""
    kind: Literal["plain", "answer", "facts"] = "plain"
    """"answer" has larger type; "facts" has two columns of names and values, without header."""

    @classmethod
    def of(cls, columns: Mapping[str, Sequence[str]], caption: str = "", align: str = "") -> "Table":
        """Return a table of columns by their heading."""
        return cls(tuple(columns), tuple(zip(*columns.values(), strict=True)), caption, align)

    @property
    def sides(self) -> str:
        """Alignment of every column, l or r."""
        columns = len(self.header or self.rows[0])
        return "ll" if self.kind == "facts" else self.align or "l" + "r" * (columns - 1)


@dataclass(frozen=True)
class Figure:
    """One drawing, or several side by side, with a caption."""

    drawings: tuple[Drawing, ...]
    caption: str


@dataclass(frozen=True)
class Verdict:
    """The findings, most important first."""

    findings: tuple[Finding, ...]


Block: TypeAlias = Paragraph | Table | Figure | Verdict


@dataclass(frozen=True)
class Section:
    """A heading with its blocks."""

    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Report:
    """A whole report."""

    title: str
    facts: str
    """One line: origin and amount of the data."""
    sections: tuple[Section, ...]
    footer: str
    """One line for the foot of every page."""
