"""jointid simulate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jointid.cli.documents import study_document
from jointid.cli.files import require_free, robot_from
from jointid.cli.options import JSON, NOMINAL_D, NOMINAL_K, OVERWRITE, named, numbers
from jointid.cli.output import made, progress
from jointid.cli.program import reported
from jointid.errors import JointIdError


@reported
def simulate(
    output: Annotated[
        Path,
        typer.Argument(parser=named, help="New study: a folder or a .zip.", show_default=False),
    ],
    inertia: Annotated[
        Path | None,
        typer.Option(
            parser=named,
            help="TOML with M and M2 (motor side, kg·m²), or a study; by default the example arm.",
        ),
    ] = None,
    drive: Annotated[str, typer.Option(help="Drive of the example arm: parallelogram or serial.")] = (
        "parallelogram"
    ),
    stiffness: Annotated[str, typer.Option("--K", help="True stiffness, N·m/rad.")] = "43,7.5",
    damping: Annotated[str, typer.Option("--D", help="True damping, N·m·s/rad.")] = "0.10,0.015",
    nominal_K: Annotated[str, NOMINAL_K] = "",
    nominal_D: Annotated[str, NOMINAL_D] = "",
    from_hz: Annotated[float, typer.Option(help="Lowest frequency, Hz.")] = 3.0,
    to_hz: Annotated[float, typer.Option(help="Highest frequency, Hz.")] = 30.0,
    count: Annotated[int, typer.Option(min=1, max=500, help="Number of frequencies.")] = 18,
    periods: Annotated[float, typer.Option(help="Length of each record, periods.")] = 12.5,
    coulomb: Annotated[str, typer.Option(help="Coulomb friction of the motors, N·m.")] = "0",
    viscous: Annotated[str, typer.Option(help="Viscous friction, N·m·s/rad.")] = "0",
    encoder_counts: Annotated[int, typer.Option(help="Counts per motor turn; 0 is ideal.")] = 65536,
    torque_noise: Annotated[str, typer.Option(help="Standard deviation of the torque, N·m.")] = "0.01",
    delay_ms: Annotated[float, typer.Option(help="Torque delay, ms.")] = 0.0,
    sample_rate_hz: Annotated[float, typer.Option(help="Sample rate of control and log, Hz.")] = 2000.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise.")] = 0,
    name: Annotated[str, typer.Option(help="Name of the study.")] = "Simulated robot",
    overwrite: Annotated[bool, OVERWRITE] = False,
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Simulate a closed-loop sine experiment and save it as a study."""
    import numpy as np

    from jointid import (
        Controller,
        Elasticity,
        Excitation,
        Measurement,
        MotorFriction,
        PlanarArm,
        Study,
        save_study,
        simulate_records,
    )

    true = Elasticity(K=numbers(stiffness), D=numbers(damping))
    friction = MotorFriction(coulomb=numbers(coulomb), viscous=numbers(viscous))
    noise = numbers(torque_noise)
    nominal = None
    if nominal_K or nominal_D:
        nominal = Elasticity(K=numbers(nominal_K), D=numbers(nominal_D))
    if inertia is None:
        arm = PlanarArm.example(drive)  # type: ignore[arg-type]  # checked there
        known = arm.inertia(arm.inverse((1.15, 0.0)))
    else:
        known = robot_from(inertia).inertia
    require_free(output, overwrite, [inertia])
    if not 0 < from_hz <= to_hz:
        raise JointIdError(f"--from-hz {from_hz:g} --to-hz {to_hz:g}: give 0 < lowest ≤ highest.")
    with progress("Simulating", quiet=as_json) as tell:
        records = simulate_records(
            known,
            true,
            np.unique(np.geomspace(from_hz, to_hz, count).round(6)),
            excitation=Excitation(periods=periods),
            controller=Controller(sample_rate_hz=sample_rate_hz, torque_delay_s=1e-3 * delay_ms),
            friction=friction,
            measurement=Measurement(encoder_counts=encoder_counts or None, torque_noise_Nm=noise),
            seed=seed,
            progress=tell,
        )
    study = Study(records=records, inertia=known, nominal=nominal, name=name, origin="simulated")
    save_study(study, output, overwrite=overwrite)
    made(study_document(study, output), study, as_json)
