"""Run the benchmarks: one table per part as Markdown, all of them as JSON.

    python -m benchmarks [part ...] [--quick] [--json FILE]

Without names all parts run except the long ones, which run only by name.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import traceback
from collections.abc import Iterator
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any

from benchmarks.harness import Table, machine, versions

PARTS = {
    "phasors": "phasors of 64 records, against numpy.sum, numba, lstsq, curve_fit and FFT",
    "transfer_matrix": "H, against pyFRF and scipy.signal.csd",
    "stiffness": "K and D, against grey-box fits in frequency and time and MuJoCo",
    "simulation": "the simulated robot and the cut, against scipy.integrate.solve_ivp and real time",
    "growth": "time and memory against samples, records and joints",
}
LONG = {
    "cramer_rao": "estimators against the Cramér–Rao bound, and their error bars",
    "gears": "laws of nonlinear gears, and linear robots called nonlinear",
    "whole_error": "errors, error bars and warnings on an independent simulated robot",
    "motion": "K and D from sweeps, random motion and moves; intervals over 200 realisations",
    "motion_peers": "K, D and inertias from two motions, against a grey-box fit in time and MuJoCo",
    "log_faults": "faults of the log: which ones cause a warning, and answers without one",
    "changing_robot": "robots that change from record to record: warnings, and answers without one",
    "random_studies": "10,000 random studies: no exception, the same answer twice, CPU time",
    "six_axes": "K and D of six axes with friction and an unknown payload, sines and motions",
    "arm_side": "K from sensors behind the gears: errors, skew, predictions of other records",
    "setpoints": "10,000 random experiments as set points: no limit exceeded in a written file",
    "mutated_logs": "100,000 damaged logs over all readers: only tables and JointIdError",
    "friction": "effect of friction and an unstated delay on the estimators",
    "app": "the app in a real browser",
    "sessions": "twenty people at one server: latency, memory and descriptors",
    "kills": "200 kills each of server, batch and convert while they write",
    "long_log": "jointid convert on 45 minutes at 1 kHz with 600 sine runs",
    "batch": "a fleet of studies",
}


def main(arguments: list[str] | None = None) -> int:
    """Run the requested parts; return 1 when one of them failed."""
    names = "\n".join(f"  {name:<16} {what}" for name, what in {**PARTS, **LONG}.items())
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="jointid compared with the software that a user would choose instead.",
        epilog=f"parts:\n{names}\n({', '.join(LONG)} only by name)",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("parts", nargs="*", metavar="part", help="which; by default the short ones")
    parser.add_argument("--quick", action="store_true", help="small sizes, to check that it runs")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write all figures to FILE")
    options = parser.parse_args(arguments)
    unknown = set(options.parts) - {*PARTS, *LONG}
    if unknown:
        parser.error(f"no such part: {', '.join(sorted(unknown))}\nparts:\n{names}")

    about = {"machine": machine(), "versions": versions(), "quick": options.quick}
    print(_about(about), flush=True)
    parts: dict[str, Any] = {}
    for name in options.parts or PARTS:
        print(f"\n### {name}\n", flush=True)
        part = parts[name] = {"seconds": 0.0, "error": None, "tables": []}
        begin = time.perf_counter()
        try:
            for table in run(name, options.quick):
                print(table.markdown(), end="\n\n", flush=True)
                part["tables"].append(table.plain())
        except Exception as error:  # a part that fails does not stop the others
            traceback.print_exc(file=sys.stderr)
            part["error"] = f"{type(error).__name__}: {error}"
            print(f"{name} failed: {part['error']}", flush=True)
        part["seconds"] = time.perf_counter() - begin
        if options.json:
            text = json.dumps({**about, "parts": parts}, indent=1, ensure_ascii=False)
            options.json.write_text(text + "\n", "utf-8")
    return int(any(part["error"] for part in parts.values()))


def run(name: str, quick: bool) -> Iterator[Table]:
    """Tables of one part, each as soon as it is measured."""
    found = import_module(f"benchmarks.{name}").measure(quick)
    rows = []
    for each in found:
        if isinstance(each, Table):
            yield each
        else:
            rows.append(asdict(each))
    if rows:  # of a part that has a kind of its own
        form = {key: "" if isinstance(value, str) else ".3g" for key, value in rows[0].items()}
        yield Table(name, {**PARTS, **LONG}[name], form, tuple(rows))


def _about(about: dict[str, Any]) -> str:
    box, known = about["machine"], about["versions"]
    libraries = ", ".join(f"{name} {version}" for name, version in known.items())
    load = "" if box["load_at_start"] is None else f", load {box['load_at_start']:.2f} at the start"
    return (
        f"{box['cpu']}, {box['cores']:.0f} cores, {box['memory_GB']:.0f} GB, {box['system']}, "
        f"Python {box['python']}{load}.\n{libraries}."
    )


if __name__ == "__main__":
    raise SystemExit(main())
