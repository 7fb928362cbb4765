"""Arguments, options and checks that several commands share."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer

from jointid.answer import STIFFNESS_UNITS
from jointid.estimation.identify_elasticity import METHODS
from jointid.files.application import sample_studies
from jointid.gears.gear import Gear
from jointid.joints import Elasticity

GEAR_FIELDS = {
    name.partition("_")[0]: name
    for name in (
        "cubic", "backlash_rad", "hysteresis_Nm", "presliding_rad", "K2", "K3", "T1_Nm", "T2_Nm"
    )
}  # fmt: skip
"""Field of a gear by its name in an option, motor side and SI units."""


def numbers_option(text: str, *names: str, **more: Any) -> Any:
    """Return an option, described by ``text``, whose value is numbers separated by commas."""
    return typer.Option(*names, metavar="NUMBERS", help=text, **more)


def known_method(value: str) -> str:
    """Check the name of an estimator."""
    if value not in METHODS:
        raise typer.BadParameter(f'"{value}" is not known. Estimators: {", ".join(METHODS)}.')
    return value


def at_joint(value: str) -> str:
    """Check the unit of K from sensors behind the gears."""
    if value and value not in _AT_JOINT:
        raise typer.BadParameter(f'"{value}" is not a unit at the joint: {", ".join(_AT_JOINT)}.')
    return value


def numbers(text: str) -> list[float]:
    """Parse numbers separated by commas."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise typer.BadParameter(f'"{text}": expected numbers separated by commas: 43,7.5') from None


def nominal(stiffness: str, damping: str) -> Elasticity | None:
    """Return the values of --nominal-K and --nominal-D; None without them."""
    if not (stiffness or damping):
        return None
    if not (stiffness and damping):
        given, missing = ("--nominal-K", "--nominal-D")[:: 1 if stiffness else -1]
        raise typer.BadParameter(f"{missing} is missing: give it together with {given}, or neither.")
    return Elasticity(K=numbers(stiffness), D=numbers(damping))


def without_none(**values: Any) -> dict[str, Any]:
    """Return the options that a person gave: without those that are None."""
    return {name: value for name, value in values.items() if value is not None}


def gears(texts: Sequence[str], joints: int) -> list[Gear]:
    """Parse laws of the gears, one text for a joint or, without its number, for all of them."""
    laws: list[dict[str, float]] = [{} for _ in range(joints)]
    for text in texts:
        joint, _, values = text.rpartition(":")
        if joint and not (joint.strip().isdecimal() and 1 <= int(joint) <= joints):
            raise typer.BadParameter(f'"{text}": the robot has joints 1 to {joints}.')
        for entry in values.split(","):
            name, _, value = (part.strip() for part in entry.partition("="))
            try:
                law = {GEAR_FIELDS[name]: float(value)}
            except (KeyError, ValueError) as error:
                fault = f'"{value}" is not a number' if name in GEAR_FIELDS else f'"{name}" is unknown'
                laws_as = f'Laws: {", ".join(GEAR_FIELDS)}, as in "1: cubic=9000, backlash=0.004".'
                raise typer.BadParameter(f'"{text}": {fault}. {laws_as}') from error
            for own in [laws[int(joint) - 1]] if joint else laws:
                own |= law
    return [Gear(**own) for own in laws]


def named(text: str) -> Path:
    """Return a path; an empty one, from an unset variable, is not this folder."""
    if not text:
        raise typer.BadParameter('"" is empty: give a file or folder; "." is the current folder')
    return Path(text)


def require_ending(option: str, file: Path, *endings: str) -> None:
    """Refuse a file name with another ending."""
    if file.suffix.lower() not in endings:
        expected = " or ".join(endings)
        raise typer.BadParameter(f"{option} {file}: expected a name that ends in {expected}.")


_AT_JOINT = [unit for unit in STIFFNESS_UNITS if unit.endswith("at the joint")]
STUDY = typer.Argument(
    parser=named,
    help=f"Study: a folder, a .zip, or the name of a sample: {', '.join(sample_studies())}.",
    show_default=False,
)
METHOD = typer.Option(
    callback=known_method,
    help="Estimator: auto (maximum likelihood with choice of the model), maximum-likelihood (no "
    "friction or delay), weighted or least-squares (linear), explicit (eq. (15) as in the paper).",
)
JSON = typer.Option("--json", help="Print only JSON.")
OVERWRITE = typer.Option("--overwrite", help="Replace existing files, which otherwise cause an error.")
INERTIA_STD = typer.Option(
    help="Relative standard deviation of M and M2: 0.03 for 3 %, 0 for exact, inf for unknown values. "
    "Default: that of the study or inertia file, else 0.05."
)
UNIT = typer.Option(
    help=f"Unit of K, and side of the gear for K and D: {', '.join(STIFFNESS_UNITS)}. At the joint "
    f"only if the study states gear_ratio. Default: {next(iter(STIFFNESS_UNITS))}.",
    show_default=False,
)
SENSOR_UNIT = typer.Option(
    callback=at_joint,
    help=f"Unit of K, which stays at the joint: {', '.join(_AT_JOINT)}. Default: {_AT_JOINT[0]}.",
    show_default=False,
)
TORQUE_STD = typer.Option(
    help="The same for the torque constants. Default: that of the study or inertia file, else exact."
)
NOMINAL_K = numbers_option("Nominal stiffness, used by the controller now, N·m/rad.", "--nominal-K")
NOMINAL_D = numbers_option("Nominal damping, N·m·s/rad.", "--nominal-D")
