"""Mutation testing: how many small changes of the product make a test fail, and which none notices.

    python -m benchmarks.mutation 40 jointid/transfer_matrix.py -- tests/test_motion_response.py
    python -m benchmarks.mutation 200 jointid/verdict -- tests/test_verdict.py tests/test_report.py

Draws so many mutants of the modules (cosmic-ray: an operator, comparison, number or condition changed),
and prints the share that the tests find and the diff of every mutant that survives. Needs
``'.[benchmarks]'``.
"""

from __future__ import annotations

import random
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from cosmic_ray.commands.init import init
from cosmic_ray.mutating import mutate_and_test
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import MutationSpec, TestOutcome

ROOT = Path(__file__).parents[1]
SEED = 1
TIMEOUT_S = 600.0
OPERATORS = (
    "AddNot",
    "NumberReplacer",
    "ReplaceAndWithOr",
    "ReplaceBinaryOperator_Add_Sub",
    "ReplaceBinaryOperator_Sub_Add",
    "ReplaceBinaryOperator_Mul_Div",
    "ReplaceBinaryOperator_Div_Mul",
    "ReplaceBinaryOperator_Pow_Mul",
    "ReplaceBreakWithContinue",
    "ReplaceComparisonOperator",
    "ReplaceContinueWithBreak",
    "ReplaceFalseWithTrue",
    "ReplaceOrWithAnd",
    "ReplaceTrueWithFalse",
    "ReplaceUnaryOperator_USub_UAdd",
)
"""Mutations that a person could make; others, such as ``|`` to ``**``, change annotations only."""


def mutants(modules: list[Path], folder: Path) -> list[MutationSpec]:
    """All mutants of the modules."""
    with use_db(str(folder / "mutants.sqlite"), WorkDB.Mode.create) as database:
        init(modules, database, {})
        found = [mutation for item in database.work_items for mutation in item.mutations]
    return [m for m in found if m.operator_name.removeprefix("core/").startswith(OPERATORS)]


def survivors(drawn: list[MutationSpec], tests: list[str], tree: Path) -> Iterator[str]:
    """The diff of each mutant that no test notices."""
    pytest = f"{sys.executable} -m pytest -x -q -n 0 -p no:cacheprovider {' '.join(tests)}"
    command = f"env -C {tree} PYTHONPATH={tree} OPENBLAS_NUM_THREADS=1 {pytest}"
    for number, mutant in enumerate(drawn, 1):
        result = mutate_and_test([mutant], command, TIMEOUT_S)
        print(f"{number} of {len(drawn)}: {result.test_outcome}", file=sys.stderr)
        if result.test_outcome is TestOutcome.SURVIVED:
            yield result.diff or ""


def main(arguments: list[str]) -> None:
    """Print the share of mutants that the tests find, and the survivors."""
    if "--" not in arguments[:-1] or not arguments[0].isdigit():
        raise SystemExit(__doc__)
    tests = arguments[arguments.index("--") + 1 :]
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        subprocess.run(["git", "clone", "--quiet", "--shared", str(ROOT), str(tree)], check=True)
        named = [tree / name for name in arguments[1 : arguments.index("--")]]
        modules = [
            m for path in named for m in (sorted(path.rglob("*.py")) if path.is_dir() else [path])
        ]
        every = mutants(modules, Path(folder))
        drawn = random.Random(SEED).sample(every, min(int(arguments[0]), len(every)))
        alive = list(survivors(drawn, tests, tree))
    killed = len(drawn) - len(alive)
    print("\n".join(alive))
    share = killed / len(drawn)
    error = (share * (1 - share) / len(drawn)) ** 0.5
    print(f"{killed} of {len(drawn)} mutants found: {share:.0%} ± {error:.0%}, drawn of {len(every)}")


if __name__ == "__main__":
    main(sys.argv[1:])
