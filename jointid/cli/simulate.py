"""jointid simulate."""

from pathlib import Path
from typing import Annotated, Any

import typer

import jointid
import jointid.cli.options as options
from jointid.cli.files import require_new_output, robot_from
from jointid.cli.output import print_new_study, progress
from jointid.errors import JointIdError


def simulate(
    output: Annotated[
        Path,
        typer.Argument(parser=options.named, help="New study: a folder or a .zip.", show_default=False),
    ],
    inertia: Annotated[
        Path | None,
        typer.Option(
            parser=options.named,
            help="TOML with M and M2 (motor side, kg·m²), or a study; by default the example arm.",
        ),
    ] = None,
    drive: Annotated[str, typer.Option(help="Drive of the example arm: parallelogram or serial.")] = (
        "parallelogram"
    ),
    stiffness: Annotated[str, options.numbers_option("True stiffness, N·m/rad.", "--K")] = "43,7.5",
    damping: Annotated[str, options.numbers_option("True damping, N·m·s/rad.", "--D")] = "0.10,0.015",
    nominal_K: Annotated[str, options.NOMINAL_K] = "",
    nominal_D: Annotated[str, options.NOMINAL_D] = "",
    from_hz: Annotated[float, typer.Option(help="Lowest frequency, Hz.")] = 3.0,
    to_hz: Annotated[float, typer.Option(help="Highest frequency, Hz.")] = 30.0,
    count: Annotated[
        int | None, typer.Option(min=1, max=500, help="Number of sine frequencies; default: 18.")
    ] = None,
    periods: Annotated[
        float | None, typer.Option(help="Length of each sine record, periods; default: 12.5.")
    ] = None,
    motion: Annotated[
        str, typer.Option(help="Motion in place of sines: sweep, multisine, random or moves.")
    ] = "",
    odd: Annotated[
        bool, typer.Option(help="Multisine on odd lines only; lines without a sine show distortion.")
    ] = False,
    duration_s: Annotated[
        float | None, typer.Option(help="Length of each motion record, s; default: 20.")
    ] = None,
    records: Annotated[
        int | None, typer.Option(min=1, max=100, help="Number of motion records; default: 2.")
    ] = None,
    coulomb: Annotated[str, options.numbers_option("Coulomb friction of the motors, N·m.")] = "0",
    viscous: Annotated[str, options.numbers_option("Viscous friction of the motors, N·m·s/rad.")] = "0",
    load_friction: Annotated[
        str,
        options.numbers_option("Load-dependent friction coefficient: friction torque over gear torque."),
    ] = "0",
    gear: Annotated[
        list[str] | None,
        typer.Option(
            help='Gear law of one joint, "1: cubic=9000", or of all, "backlash=0.004, hysteresis=0.08, '
            'presliding=0.002"; repeatable. Motor side: cubic (N·m/rad³), backlash (total, rad), '
            "hysteresis (N·m) with presliding (rad), K2 and K3 (slopes, N·m/rad) above T1 and T2 (N·m)."
        ),
    ] = None,
    encoder_counts: Annotated[
        int, typer.Option(min=0, help="Encoder counts per motor turn; 0: no rounding.")
    ] = 65536,
    torque_noise: Annotated[
        str, options.numbers_option("Standard deviation of the torque noise, N·m.")
    ] = "0.01",
    delay_ms: Annotated[float, typer.Option(help="Delay of the torque after its sample, ms.")] = 0.0,
    sample_rate_hz: Annotated[float, typer.Option(help="Sample rate of control and log, Hz.")] = 2000.0,
    inertia_error: Annotated[
        float,
        typer.Option(help="Relative error of M and M2 in the study: 0.05 for 5 %."),
    ] = 0.0,
    torque_gain: Annotated[str, options.numbers_option("Ratio of logged to true torque.")] = "1",
    added: Annotated[
        str,
        typer.Option(
            metavar="MATRIX",
            help="Add records with a payload of this exactly known contribution to M2, kg·m², rows "
            'separated by semicolons: "0.001,0;0,0.002".',
        ),
    ] = "",
    inertia_std: Annotated[float | None, options.INERTIA_STD] = None,
    torque_std: Annotated[float | None, options.TORQUE_STD] = None,
    seed: Annotated[int, typer.Option(min=0, help="Random seed of noise and motion.")] = 0,
    name: Annotated[str, typer.Option(help="Name of the study.")] = "Simulated robot",
    overwrite: Annotated[bool, options.OVERWRITE] = False,
    as_json: Annotated[bool, options.JSON] = False,
) -> None:
    """Simulate an experiment and save it as a study.

    The joints move in sines or another motion under joint control. Values are at the motor. NUMBERS:
    one value for all joints, or one per joint, separated by commas: 43,7.5.
    """
    import numpy as np

    from jointid.importing.robot_inertia import KnownRobot
    from jointid.simulation.closed_loop import simulate_campaign

    true = jointid.Elasticity(K=options.numbers(stiffness), D=options.numbers(damping))
    F_c, F_v, load = (options.numbers(each) for each in (coulomb, viscous, load_friction))
    friction = jointid.MotorFriction(coulomb=F_c, viscous=F_v, load=load)
    noise = options.numbers(torque_noise)
    assumed = options.nominal(nominal_K, nominal_D)
    if inertia is None:
        arm = jointid.PlanarArm.example(drive)  # type: ignore[arg-type]  # checked there
        robot = KnownRobot(arm.inertia(arm.inverse((1.15, 0.0))))
    else:
        robot = robot_from(inertia)
    require_new_output(output, overwrite, [inertia])
    if not 0 < from_hz <= to_hz:
        raise JointIdError(f"--from-hz {from_hz:g} --to-hz {to_hz:g}: give 0 < lowest ≤ highest.")
    if motion and (count or periods):
        raise JointIdError("--count and --periods belong to sines: use --records and --duration-s.")
    if not motion and (duration_s or records or odd):
        raise JointIdError("--duration-s, --records and --odd belong to a motion: add --motion.")
    experiment: Any = np.unique(np.geomspace(from_hz, to_hz, count or 18).round(6))
    length = 12.5 if periods is None else periods
    settings: dict[str, Any] = {"excitation": jointid.Excitation(periods=length)}
    if motion:
        length = 20.0 if duration_s is None else duration_s
        experiment = jointid.Motion(motion, from_hz, to_hz, length, odd=odd)
        settings = {"records": records or 2}
    with progress("Simulating") as tell:
        campaign = simulate_campaign(
            robot.inertia,
            true,
            experiment,
            **settings,
            controller=jointid.Controller(sample_rate_hz=sample_rate_hz, torque_delay_s=1e-3 * delay_ms),
            friction=friction,
            gears=options.gears(gear, robot.inertia.n) if gear else None,
            measurement=jointid.Measurement(
                encoder_counts=encoder_counts or None,
                torque_noise_Nm=noise,
                torque_gain=options.numbers(torque_gain),
            ),
            inertia_error=inertia_error,
            added=[options.numbers(row) for row in added.split(";")] if added.strip() else None,
            seed=seed,
            progress=tell,
        )
    study = jointid.Study(
        **campaign._asdict(),
        nominal=assumed,
        name=name,
        origin="simulated",
        **options.without_none(inertia_std=robot.inertia_std, torque_std=robot.torque_std)
        | options.without_none(inertia_std=inertia_std, torque_std=torque_std),
    )
    jointid.save_study(study, output, overwrite=overwrite)
    print_new_study(study, output, as_json)
