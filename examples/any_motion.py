"""K from two records of five seconds in random motion, in place of sines."""

from __future__ import annotations

from jointid import (
    Elasticity,
    Inertia,
    Measurement,
    Motion,
    MotorFriction,
    identify_motion,
    simulate_motion,
)


def main() -> None:
    inertia = Inertia(M=[0.0025, 0.0010], M2=[[0.0041, 0.0004], [0.0004, 0.0019]])
    records = simulate_motion(
        inertia,
        Elasticity(K=[43.0, 7.5], D=[0.10, 0.015]),
        Motion("random", from_hz=2, to_hz=40, duration_s=5.0),
        records=2,
        friction=MotorFriction(coulomb=[0.02, 0.005]),
        measurement=Measurement(encoder_counts=65536, torque_noise_Nm=0.01),
    )
    for std in (0.0, 0.05):
        fit = identify_motion(records, inertia, inertia_std=std, friction=True)
        assert fit.friction is not None
        print(f"inertias known to {std:.0%}, Coulomb friction {fit.friction.coulomb.round(4)} N·m")
        for name, value, error in zip(("K1", "K2"), fit.K, fit.standard_error[:2], strict=True):
            print(f"  {name} = {value:.3f} ± {error:.2g} N·m/rad")


if __name__ == "__main__":
    main()
