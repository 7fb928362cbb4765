"""Path error before and after identification: simulated cut of 28 × 45 mm rectangles at 300 mm/s."""

from __future__ import annotations

from pathlib import Path

from jointid import Elasticity, PlanarArm, analyse, load_study, rectangle, track

SAMPLE = Path(__file__).parents[1] / "sample_data" / "paper.zip"
ROBOT = Elasticity(K=[43.0, 7.5], D=[0.10, 0.015])  # of the simulated robot of this sample


def main() -> None:
    study = load_study(SAMPLE)
    identified = analyse(study).fit.elasticity
    assert study.nominal is not None
    print("corner zone   nominal    identified")
    for zone_mm in (1, 5, 10):
        path = rectangle(zone_m=zone_mm / 1000)
        errors_mm = [
            1000 * track(PlanarArm.example(), path, ROBOT, assumed).max_contour_error_m
            for assumed in (study.nominal, identified)
        ]
        print(f"{zone_mm:8d} mm {errors_mm[0]:8.2f} mm {errors_mm[1]:9.3f} mm")


if __name__ == "__main__":
    main()
