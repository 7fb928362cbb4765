"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path

import typer

from jointid.estimation.elasticity import METHODS
from jointid.files.application import sample_studies


def known_method(value: str) -> str:
    """Name of an estimator."""
    if value not in METHODS:
        raise typer.BadParameter(f'"{value}" is not known. Methods: {", ".join(METHODS)}.')
    return value


def numbers(text: str) -> list[float]:
    """Numbers with commas between them."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise typer.BadParameter(
            f'"{text}": expected numbers with commas between, as in 43,7.5'
        ) from None


def named(text: str) -> Path:
    """Path that is named: an empty one, as a variable that is not set leaves it, is not this folder."""
    if not text:
        raise typer.BadParameter('"" is empty: name a file or folder; this folder is "."')
    return Path(text)


STUDY = typer.Argument(
    parser=named,
    help=f"Study: a folder, a .zip, or the name of a sample: {', '.join(sample_studies())}.",
    show_default=False,
)
METHOD = typer.Option(callback=known_method, help=f"Estimator: {', '.join(METHODS)}.")
JSON = typer.Option("--json", help="Print JSON and nothing else.")
