"""jointid compare."""

from pathlib import Path
from typing import Annotated

import typer

from jointid.analysis import NOT_USABLE, WITH_CARE, Analysis, Answer
from jointid.cli.files import answer_file
from jointid.cli.options import JSON, METHOD, STUDY, UNIT, named
from jointid.cli.output import print_columns, print_json
from jointid.errors import JointIdError
from jointid.files.digest import study_digest
from jointid.uncertainty.comparison import (
    INDEPENDENT_ERRORS,
    Difference,
    comparable,
    comparison_sentence,
    values_shown,
)
from jointid.uncertainty.comparison import compare as compare_quantities
from jointid.wording import enumerated

SECOND = typer.Argument(parser=named, help="Study to compare with STUDY.", show_default=False)


def compare(
    study: Annotated[Path, STUDY],
    second: Annotated[Path, SECOND],
    method: Annotated[str, METHOD] = "auto",
    unit: Annotated[str, UNIT] = "",
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Compare K and D of two studies: which robot is softer.

    The difference is the second study minus the first, also in standard errors σ. An answer
    that is not usable is shown without values and differences.
    """
    files = study, second
    found: list[Answer] = [answer_file(file, method) for file in files]
    if len({study_digest(each.study) for each in found}) == 1:
        raise JointIdError(f"{study} and {second} are the same study: give two different studies.")
    names = [each.study.name or file.name for each, file in zip(found, files, strict=True)]
    found = [each.shown_in(unit) for each in found] if unit else found
    found[:] = comparable(*found)
    rows = compare_quantities(found[0].quantities, found[1].quantities)
    usable = all(each.state != NOT_USABLE for each in found)
    if as_json:
        _print_json(names, found, rows, usable)
        return
    _print_heading(names, found, rows, usable)
    columns = {"": [f"{row.first.name} ({row.first.unit})" for row in rows]}
    columns["first"] = values_shown((row.first for row in rows), usable=found[0].state != NOT_USABLE)
    columns["second"] = values_shown((row.second for row in rows), usable=found[1].state != NOT_USABLE)
    if usable:
        columns["difference"] = [row.change for row in rows]
        columns["significant"] = [row.significance for row in rows]
    print_columns(columns, right=(1, 2, 3))
    what = "K and D" if all(isinstance(each, Analysis) for each in found) else "K"
    print(f"{what} {found[0].unit.side}." + usable * f" {INDEPENDENT_ERRORS}")


def _print_heading(
    names: list[str], found: list[Answer], rows: tuple[Difference, ...], usable: bool
) -> None:
    for which, name, each in zip(("First", "Second"), names, found, strict=True):
        method = "" if isinstance(each, Analysis) else f", {each.fit.method}"
        print(f'{which}: "{name}"{method}, {each.state}')
        if each.state == NOT_USABLE:
            print(each.headline)
    if not usable:
        return
    unstated = any(not each.torque_stated for each in found)
    first, second = (f'"{name}"' for name in names)
    said = comparison_sentence(rows, first, second, exact_torque_scales=unstated)
    doubtful = [f'"{n}"' for n, each in zip(names, found, strict=True) if each.state == WITH_CARE]
    if doubtful:
        said += (
            f", but {enumerated(doubtful)} {'are' if len(doubtful) > 1 else 'is'} usable with care only"
        )
    print(f"{said}.")


def _print_json(
    names: list[str], found: list[Answer], rows: tuple[Difference, ...], usable: bool
) -> None:
    studies = [
        {"name": name, "state": each.state, "answer": each.headline, "digest": study_digest(each.study)}
        for name, each in zip(names, found, strict=True)
    ]
    differences = [
        {
            "name": row.first.name,
            "unit": row.first.unit,
            "first": row.first.value,
            "first_error": row.first.error,
            "second": row.second.value,
            "second_error": row.second.error,
            "relative": row.relative if usable else None,
            "sigmas": row.sigmas if usable else None,
        }
        for row in rows
    ]
    print_json({"first": studies[0], "second": studies[1], "differences": differences})
