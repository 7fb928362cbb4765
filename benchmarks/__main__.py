"""Run the benchmarks: one table per part as Markdown, all of them as JSON.

    python -m benchmarks [part ...] [--quick] [--json FILE]

Without names every part runs but the long ones, which are run by name.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import traceback
from dataclasses import asdict
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from benchmarks.harness import Table, machine, versions

PARTS = {
    "phasors": "phasors of 64 records, against numpy.sum, numba, lstsq, curve_fit and FFT",
    "transfer_matrix": "H, against pyFRF and scipy.signal.csd",
    "stiffness": "K and D, against grey-box fits in frequency and time and MuJoCo",
    "simulation": "the simulated robot and the cut, against scipy.integrate.solve_ivp and real time",
    "growth": "time and memory against samples, records and joints; draws docs/growth.svg",
}
LONG = {
    "cramer_rao": "estimators against the Cramér-Rao bound, and their error bars",
    "friction": "what friction and an untold delay do to the estimators",
    "app": "the app in a real browser",
    "batch": "a fleet of studies",
}


def main(arguments: list[str] | None = None) -> int:
    """Run the parts that were asked for; 1 when one of them failed."""
    names = "\n".join(f"  {name:<16} {what}" for name, what in {**PARTS, **LONG}.items())
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="jointid against what a user would pick instead.",
        epilog=f"parts:\n{names}\n({', '.join(LONG)} only by name)",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("parts", nargs="*", metavar="part", help="which; by default the short ones")
    parser.add_argument("--quick", action="store_true", help="small sizes: does it run at all")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures there as well")
    options = parser.parse_args(arguments)
    unknown = set(options.parts) - {*PARTS, *LONG}
    if unknown:
        parser.error(f"no such part: {', '.join(sorted(unknown))}\nparts:\n{names}")

    about = {"machine": machine(), "versions": versions(), "quick": options.quick}
    print(_about(about), flush=True)
    parts: dict[str, Any] = {}
    for name in options.parts or PARTS:
        begin = time.perf_counter()
        tables, error = run(name, options.quick)
        parts[name] = {
            "seconds": time.perf_counter() - begin,
            "error": error,
            "tables": [table.plain() for table in tables],
        }
        print(f"\n### {name}\n", flush=True)
        for table in tables:
            print(table.markdown(), end="\n\n", flush=True)
        if error:
            print(f"{name} failed: {error}", flush=True)
        if options.json:
            text = json.dumps({**about, "parts": parts}, indent=1, ensure_ascii=False)
            options.json.write_text(text + "\n", "utf-8")
    return int(any(part["error"] for part in parts.values()))


def run(name: str, quick: bool) -> tuple[tuple[Table, ...], str | None]:
    """Tables of one part; what keeps it from being measured does not stop the others."""
    if find_spec(f"benchmarks.{name}") is None:
        return (), "it is not part of this checkout"
    try:
        module = import_module(f"benchmarks.{name}")
        if not hasattr(module, "measure"):
            return (), f"it runs by itself: python benchmarks/{name}.py --help"
        return _tables(name, list(module.measure(quick))), None
    except Exception as error:
        traceback.print_exc(file=sys.stderr)
        return (), f"{type(error).__name__}: {error}"


def _tables(name: str, found: list[Any]) -> tuple[Table, ...]:
    """Tables as they are; the rows of a part that has its own kind, as one table."""
    if all(isinstance(each, Table) for each in found):
        return tuple(found)
    rows = tuple(asdict(row) for row in found)
    form = {key: "" if isinstance(value, str) else ".3g" for key, value in rows[0].items()}
    return (Table(name, {**PARTS, **LONG}[name], form, rows),)


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
