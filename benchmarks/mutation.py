"""Mutation testing: share of small changes of the product that make a test fail, and those that do not.

    python -m benchmarks.mutation 40 jointid/transfer_matrix.py -- tests/test_motion_response.py
    python -m benchmarks.mutation 200 jointid/verdict -- tests/test_verdict.py tests/test_report.py

Draws that many mutants of the modules (cosmic-ray: operator, comparison, number or condition changed),
and prints the share that the tests find and every mutant that survives without a reason in
``benchmarks/survivors.toml``. Each mutant is tested in a fork that has loaded all libraries, by the
tests that call the changed function; those that find most mutants per second come first.
``MUTATION_SEED=2`` draws others, and ``MUTATION_LONGEST_S=2`` also runs tests of up to 2 s of CPU.
Needs ``'.[benchmarks]'``.
"""

from __future__ import annotations

import ast
import difflib
import importlib
import importlib.util
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any

import pytest
from cosmic_ray.commands.init import init
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import MutationSpec
from hypothesis import Phase, settings

ROOT = Path(__file__).parents[1]
REASONS = tomllib.loads((Path(__file__).parent / "survivors.toml").read_text("utf-8"))
"""Reasons of accepted survivors: by module, then by the changed line, or by part of any line."""
SEED = int(os.environ.get("MUTATION_SEED", "1"))
LONGEST = 4.0
"""CPU time of a mutant over that of the tests, above which it counts as found: it never ends."""
TIMEOUT_S = 60
"""Of a test, far above its CPU time."""
LONGEST_TEST_S = float(os.environ.get("MUTATION_LONGEST_S", "0.4"))
"""CPU time, with all libraries loaded. Longer tests are left out: they would take most of the time."""
LONGEST_NOTED_S = 3 * LONGEST_TEST_S + 4
"""CPU time at which a test ends while its calls are noted and libraries loaded, which takes longer."""
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
    names = ((m, m.operator_name.removeprefix("core/")) for m in found)
    return [
        m for m, name in names if name.startswith(OPERATORS) and not name.endswith(("_Is", "_IsNot"))
    ]


def changed_part(path: Path, line: int) -> tuple[str, set[str]]:
    """Innermost function with this line, by module and first line; outside of any, the names set."""
    inner, names = 0, set[str]()
    tree = ast.parse(path.read_text("utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            first = min(part.lineno for part in [node, *node.decorator_list])
            if first <= line <= (node.end_lineno or 0):
                inner = max(inner, first)
    for node in tree.body:
        if node.lineno <= line <= (node.end_lineno or 0):
            names |= {
                n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
            }
            names |= {node.name} if isinstance(node, ast.ClassDef) else set()
    return (f"{path}:{inner}", set()) if inner else ("", names)


class Tests:
    """Tests of a copy of the project, which forks of this process run."""

    def __init__(self, tree: Path, files: list[str], modules: list[Path]) -> None:
        self._tree, self._files, self._modules = tree, files, {str(m) for m in modules}
        self._seconds: dict[str, float] = {}
        self._found: Counter[str] = Counter()
        self._chosen: set[str] = set()
        self._tracing, self._now = True, [""]
        self._calls: defaultdict[str, set[str]] = defaultdict(set)
        """Tests and fixtures that call each function."""
        self._limit_s = resource.RLIM_INFINITY
        self._must_pass()  # loads the libraries
        self._tracing = False
        self._seconds = {test: s for test, s in self._seconds.items() if s >= LONGEST_NOTED_S}
        begin = sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
        self._must_pass()
        spent = sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2]) - begin
        self._limit_s = int(LONGEST * spent) + 60

    def _must_pass(self) -> None:
        failed = self.first_failure()
        if failed:
            raise SystemExit(f"{failed} fails without a mutation.")

    def that_use(self, path: Path, line: int) -> set[str]:
        """Tests that call the function of the line; outside of any, those of modules with its names.

        The latter with tests that call nothing: they may read the source.
        """
        function, names = changed_part(path, line)
        users = [m for m in self._modules if any(name in Path(m).read_text("utf-8") for name in names)]
        called = [function, *(f for f in self._calls if f.rpartition(":")[0] in users)]
        found = {test for f in called for test in self._calls[f] if "::" in test}
        return found if function else found | set(self._seconds).difference(*self._calls.values())

    def first_failure(self, chosen: set[str] | None = None) -> str:
        """The first of the chosen tests that fails, or "" if all pass."""
        if chosen is not None and not chosen:
            return ""
        self._chosen = chosen or set()
        answer = self._tree.parent / "answer.json"
        answer.unlink(missing_ok=True)
        child = os.fork()
        if child == 0:
            try:
                resource.setrlimit(resource.RLIMIT_CPU, (self._limit_s, resource.RLIM_INFINITY))
                self._run(answer)
            finally:
                os._exit(0)
        os.waitpid(child, 0)
        if not answer.exists():
            return "a crash, or an endless loop"
        told: dict[str, Any] = json.loads(answer.read_text())
        self._seconds = {**told["seconds"], **self._seconds}
        for name in told["libraries"]:
            with suppress(Exception):
                importlib.import_module(name)
        for function, tests in told["calls"].items():
            self._calls[function].update(tests)
        self._found[told["failed"]] += 1
        return str(told["failed"])

    def _run(self, answer: Path) -> None:
        """Run the tests and write their outcome; the process ends here."""
        os.chdir(self._tree)
        signal.signal(signal.SIGPROF, lambda *_: pytest.skip("too long"))
        sys.path[:0] = [str(self._tree), str(self._tree / "tests")]
        os.environ["PYTHONPATH"] = str(self._tree)
        with open(os.devnull, "w") as silent:
            os.dup2(silent.fileno(), 1)
            os.dup2(silent.fileno(), 2)
        options = [
            "-x",
            "-q",
            "-n",
            "0",
            "-p",
            "no:cacheprovider",
            "-W",
            "ignore:Module already imported",
            "-o",
            f"timeout={TIMEOUT_S}",
        ]
        # A failure is enough: no search for the simplest one.
        settings.register_profile("mutants", phases=[Phase.explicit, Phase.generate], database=None)
        settings.load_profile("mutants")
        files = sorted({test.partition("::")[0] for test in self._chosen}) or self._files
        code = pytest.main([*options, *files], [self])
        failed = self._failed if code == 1 else "" if code in (0, 5) else "an import"
        libraries = [
            name
            for name, module in [*sys.modules.items()]
            if "site-packages" in (getattr(module, "__file__", None) or "")
        ]
        calls = {function: sorted(tests - {""}) for function, tests in self._calls.items()}
        told = {"failed": failed, "seconds": self._seconds, "libraries": libraries, "calls": calls}
        answer.write_text(json.dumps(told))

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Tests that find most mutants per second first."""
        if self._chosen:
            items[:] = [i for i in items if i.nodeid in self._chosen]
        items[:] = [i for i in items if self._seconds.get(i.nodeid, 0.0) < LONGEST_TEST_S]
        items.sort(key=lambda i: self._seconds.get(i.nodeid, 0.0) / (self._found[i.nodeid] + 0.1))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        """Note the CPU time of a test, and what it calls."""
        begin = time.process_time()
        if self._tracing:
            signal.setitimer(signal.ITIMER_PROF, LONGEST_NOTED_S)
        try:
            with self._noting(item.nodeid):
                yield
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
            self._seconds[item.nodeid] = time.process_time() - begin
        if self._tracing:  # a fixture may have been made for an earlier test
            fixtures = {f"fixture {name}" for name in getattr(item, "fixturenames", ())}
            for tests in self._calls.values():
                if tests & fixtures:
                    tests.add(item.nodeid)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[Any]) -> Iterator[Any]:
        """Note what a fixture calls."""
        with self._noting(f"fixture {fixturedef.argname}"):
            return (yield)

    @contextmanager
    def _noting(self, name: str) -> Iterator[None]:
        """Note that the test or fixture calls the functions that are called meanwhile."""

        def called(frame: FrameType, event: str, _: object) -> None:
            if frame.f_code.co_filename in self._modules:
                place = f"{frame.f_code.co_filename}:{frame.f_code.co_firstlineno}"
                self._calls[place].update(self._now)

        if not self._tracing:
            yield
            return
        self._now.append(name)
        sys.settrace(called)
        try:
            yield
        finally:
            self._now.pop()
            sys.settrace(called if self._now[1:] else None)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note a failure."""
        if report.failed:
            self._failed = report.nodeid


def survivors(drawn: list[MutationSpec], tests: Tests, tree: Path) -> Iterator[tuple[str, str, str]]:
    """Module, changed line and difference of each mutant that no test detects."""
    for number, mutant in enumerate(drawn, 1):
        path = Path(mutant.module_path)
        before = path.read_text("utf-8")
        chosen = tests.that_use(path, mutant.start_pos[0])
        operator = get_operator(mutant.operator_name)(**dict(mutant.operator_args))
        after = mutate_code(before, operator, mutant.occurrence) or before
        compiled = Path(importlib.util.cache_from_source(str(path)))
        try:
            path.write_text(after, "utf-8")
            compiled.unlink(missing_ok=True)  # it may have the same size and second
            failed = tests.first_failure(chosen)
        finally:
            path.write_text(before, "utf-8")
            compiled.unlink(missing_ok=True)
        print(f"{number} of {len(drawn)}: {failed or 'survived'}", file=sys.stderr, flush=True)
        if not failed:
            name = str(path.relative_to(tree))
            lines = [
                *difflib.unified_diff(before.split("\n"), after.split("\n"), name, name, "", "", 2, "")
            ]
            changed = " ".join(line[1:].strip() for line in lines[2:] if line.startswith("+"))
            yield name, changed, "\n".join(lines)


def main(arguments: list[str]) -> None:
    """Print the share of mutants that the tests find, and the survivors."""
    if "--" not in arguments[:-1] or not arguments[0].isdigit():
        raise SystemExit(__doc__)
    files = arguments[arguments.index("--") + 1 :]
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        subprocess.run(["git", "clone", "--quiet", "--shared", str(ROOT), str(tree)], check=True)
        named = [tree / name for name in arguments[1 : arguments.index("--")]]
        modules = [
            m for path in named for m in (sorted(path.rglob("*.py")) if path.is_dir() else [path])
        ]
        every = mutants(modules, Path(folder))
        drawn = random.Random(SEED).sample(every, min(int(arguments[0]), len(every)))
        alive, reasons = 0, 0
        for name, changed, text in survivors(drawn, Tests(tree, files, modules), tree):
            alive += 1
            anywhere = any(part in changed for part in REASONS["*"])
            if anywhere or changed in REASONS.get(name, {}):
                reasons += 1
            else:
                print(text, flush=True)
    counted = len(drawn) - reasons
    share = (len(drawn) - alive) / max(counted, 1)
    error = (share * (1 - share) / max(counted, 1)) ** 0.5
    print(
        f"{len(drawn) - alive} of {counted} mutants found: {share:.0%} ± {error:.0%}; {len(drawn)} "
        f"drawn of {len(every)}, of which {reasons} survive for a reason and do not count"
    )


if __name__ == "__main__":
    main(sys.argv[1:])
