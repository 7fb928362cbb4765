"""Layers of the package, read from its imports: they point down, and each library has one home."""

from __future__ import annotations

import ast
import subprocess
import sys
import warnings
from collections import Counter
from collections.abc import Iterator
from fnmatch import fnmatch
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]
FILES = sorted([*(ROOT / "jointid").rglob("*.py"), *(ROOT / "pages").glob("*.py"), *ROOT.glob("app.py")])
STUBS = {file.with_suffix(".py"): file for file in sorted((ROOT / "jointid").rglob("__init__.pyi"))}
"""Which names a package offers and where they live: its ``__init__`` imports them when they are used."""

HOMES = {
    "streamlit": ["jointid/ui/*", "app.py", "pages/*"],
    "uvicorn": ["jointid/ui/server/serving.py"],
    "starlette": ["jointid/ui/server/serving.py"],
    "plotly": ["jointid/figures/*"],
    "pymunk": ["jointid/cut/arm_simulation.py"],
    "pandas": ["jointid/files/*", "jointid/importing/*", "jointid/ui/shared/page.py"],
    "pyarrow": ["jointid/files/*", "jointid/importing/*", "jointid/fleet/table.py"],
    "distributed": ["jointid/fleet/cluster.py"],
    "dask": ["jointid/fleet/cluster.py"],
    "tomli_w": ["jointid/files/*", "jointid/exporting/*"],
    "reportlab": ["jointid/reporting/pdf*.py"],
    "control": ["jointid/exporting/*"],
    "h5py": ["jointid/importing/read/*"],
    "openpyxl": ["jointid/importing/read/*"],
    "python_calamine": ["jointid/importing/read/*"],
    "rosbags": ["jointid/importing/read/*"],
    "threadpoolctl": ["jointid/small_matrices.py"],
    "lazy_loader": ["jointid/__init__.py", "jointid/*/__init__.py"],
    "pinocchio": ["jointid/robot_models/urdf.py"],
    "typer": ["jointid/cli/*"],
    "rich": ["jointid/cli/*"],
    "numpy": ["*"],
    "scipy": ["jointid/*"],
}  # fmt: skip
"""Where each library may be imported."""

FLOORS = [
    ["errors"],
    ["arrays", "wording"],
    ["small_matrices", "background", "parsing"],
    ["records", "joints"],
    ["robot_models"],
    ["phasors"],
    ["gears"],
    ["simulation", "motion", "arm_side"],
    ["transfer_matrix"],
    ["estimation"],
    ["answer", "uncertainty"],
    ["verdict"],
    ["study"],
    ["analysis"],
    ["files", "cut", "corrections"],
    ["importing", "exporting", "setpoints"],
    ["fleet", "figures"],
    ["reporting"],
    ["cli", "ui"],
    ["__main__"],
]
"""Modules and rooms of the package from the ground up; every one has its floor."""

MUTABLE = {"Fits", "Search", "OpenFleet"}
"""Dataclasses that collect results."""

LINES = 350
"""Most lines of a module."""

ARROWS = 186
"""Most pairs of rooms of which one imports the other."""


@cache
def tree(file: Path) -> ast.Module:
    """Syntax tree; what the compiler warns of is for other tests."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return ast.parse(file.read_text("utf-8"))


def name_of(file: Path) -> str:
    """Module name; a package's __init__ is the package."""
    return ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """The node and all statements in it, without their expressions."""
    yield node
    for name in ("body", "orelse", "finalbody", "handlers", "cases"):
        for child in getattr(node, name, ()):
            yield from statements(child)


@cache
def offered(stub: Path) -> dict[str, str]:
    """Names in a stub by the module that each comes from; a stub imports from its own package only."""
    found = {}
    for node in tree(stub).body:
        assert isinstance(node, ast.ImportFrom), f"{stub}:{node.lineno}"
        assert node.level == 1, f"{stub}:{node.lineno}"
        for alias in node.names:
            assert alias.asname == alias.name, f"{stub}:{node.lineno}: {alias.name} is not exported"
            found[alias.name] = f"{name_of(stub)}.{node.module}"
    return found


@cache
def imported(file: Path) -> frozenset[str]:
    """Every module that a file imports, inside functions as well, and by the stub beside it."""
    found = set(offered(STUBS[file]).values()) if file in STUBS else set[str]()
    for node in statements(tree(file)):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file.name}: relative import"
            found.add(str(node.module))
            found.update(f"{node.module}.{alias.name}" for alias in node.names)
    return frozenset(found)


@cache
def graph() -> dict[str, set[str]]:
    """Imports among the modules of the package, without the façade ``jointid`` itself."""
    modules = {name_of(file) for file in FILES}
    below = {name_of(file): set(imported(file)) & modules - {"jointid"} for file in FILES}
    return {module: targets - {module} for module, targets in below.items() if module != "jointid"}


def reached(module: str) -> set[str]:
    seen: set[str] = set()
    todo = [module]
    while todo:
        for target in graph()[todo.pop()] - seen:
            seen.add(target)
            todo.append(target)
    return seen


def printed(program: str) -> str:
    """What a program prints in an interpreter of its own."""
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, check=True
    )
    return run.stdout.strip()


def floor(module: str) -> int:
    """Floor of a module of the package; pages and app.py have the highest."""
    if not module.startswith("jointid."):
        return len(FLOORS)
    part = module.split(".")[1]
    return next(i for i, rooms in enumerate(FLOORS) if part in rooms)


def room(file: Path) -> str:
    return file.parent.relative_to(ROOT).as_posix()


def test_the_package_has_modules() -> None:
    assert {
        "jointid.joints",
        "jointid.phasors.extract",
        "jointid.estimation.elasticity",
    } <= graph().keys()
    assert "jointid.records" in graph()["jointid.phasors.extract"]


def test_each_outside_library_is_imported_in_one_package() -> None:
    wrong = set()
    for file in FILES:
        where = file.relative_to(ROOT).as_posix()
        for module in imported(file):
            library = module.split(".")[0]
            if library in sys.stdlib_module_names or library == "jointid":
                continue
            homes = HOMES.get(library, [])
            if not any(fnmatch(where, home) for home in homes):
                wrong.add(f"{where} imports {library}: only {homes} may")
    assert not wrong


def test_imports_point_down() -> None:
    wrong = set()
    for module in graph():
        below = reached(module)
        if module in below:
            wrong.add(f"{module} imports itself in a circle")
        wrong |= {f"{module} imports {t}" for t in below if floor(t) > floor(module)}
    assert not wrong


def test_packages_of_one_layer_import_in_one_direction() -> None:
    """No circle between rooms, even where every module alone imports downwards."""
    rooms = {name_of(file): room(file) for file in FILES}
    arrows = {(rooms[a], rooms[b]) for a in graph() for b in graph()[a] if rooms[a] != rooms[b]}
    assert len(arrows) <= ARROWS
    arrows = {(a, b) for a, b in arrows if "jointid" not in (a, b)}  # the root is no room
    assert not {(a, b) for a, b in arrows if (b, a) in arrows}


def test_ui_packages_import_only_shared_modules() -> None:
    parts = {module: module.split(".")[2] for module in graph() if module.startswith("jointid.ui.")}
    wrong = {
        f"{a} imports {b}"
        for a in parts
        for b in graph()[a] & parts.keys()
        if parts[b] not in ("shared", parts[a])
    }
    assert not wrong


def test_packages_have_few_modules() -> None:
    sizes = Counter(room(file) for file in FILES)
    assert sizes["jointid"] <= 12
    assert max(sizes.values()) <= 16, sizes.most_common(3)


def test_modules_are_short() -> None:
    lines = {f.relative_to(ROOT).as_posix(): f.read_text("utf-8").count("\n") for f in FILES}
    longer = {file: count for file, count in lines.items() if count > LINES}
    assert not longer


def test_dataclasses_are_frozen_and_compare_no_arrays() -> None:
    """A value that changes, or an equality that fails with arrays, is found far from its cause."""
    for file in FILES:
        for node in statements(tree(file)):
            made = [ast.unparse(d) for d in getattr(node, "decorator_list", ())]
            if not isinstance(node, ast.ClassDef) or not any(d.startswith("dataclass") for d in made):
                continue
            held = {
                name.id
                for line in node.body
                if isinstance(line, ast.AnnAssign)
                for name in ast.walk(line.annotation)
                if isinstance(name, ast.Name)
            }
            place = f"{file}: {node.name}"
            assert any("frozen=True" in d for d in made) != (node.name in MUTABLE), place
            if node.name not in MUTABLE and held & {"Floats", "Complexes"}:
                assert any("eq=False" in d for d in made), place


def test_library_modules_do_not_import_from_the_package_root() -> None:
    """``from jointid import …`` is for what stands above the library: pages, ui, cli."""
    wrong = set()
    for file in FILES:
        module = name_of(file)
        if not module.startswith("jointid.") or module.split(".")[1] in ("ui", "cli"):
            continue
        if "jointid" in imported(file):
            wrong.add(module)
    assert not wrong


def test_importing_the_library_loads_no_heavy_modules() -> None:
    """What is asked for is imported then; the library loads nothing that only some need."""
    heavy = ("streamlit", "plotly", "pymunk", "pandas", "reportlab")
    program = (
        "import sys, jointid; print('numpy' in sys.modules); import jointid.study;"
        f"print([m for m in {heavy} if m in sys.modules])"
    )
    assert printed(program).split("\n") == ["False", "[]"]


SHORT_WAYS = ("print", "exit", "quit", "sys.exit")


def test_the_library_neither_prints_nor_exits() -> None:
    wrong = set()
    for file in FILES:
        if not file.is_relative_to(ROOT / "jointid") or file.is_relative_to(ROOT / "jointid/cli"):
            continue
        for node in ast.walk(tree(file)):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
                last = node.func.id if isinstance(node.func, ast.Name) else node.func.attr
                if last in ("print", "exit", "quit") and ast.unparse(node.func) in SHORT_WAYS:
                    wrong.add(f"{file.name}:{node.lineno}")
    assert not wrong


def test_everything_public_is_there_and_named_once() -> None:
    import jointid

    assert sorted(jointid.__all__) == list(jointid.__all__)
    assert len(set(jointid.__all__)) == len(jointid.__all__)
    assert all(hasattr(jointid, name) for name in jointid.__all__)


@pytest.mark.parametrize("stub", STUBS.values(), ids=name_of)
def test_a_package_offers_what_its_stub_says(stub: Path) -> None:
    package = import_module(name_of(stub))
    names = offered(stub)
    assert sorted(names) == sorted(package.__all__) == sorted(dir(package))
    for name, module in names.items():
        assert getattr(package, name) is getattr(import_module(module), name)


def test_no_name_is_hidden_by_the_module_it_lives_in() -> None:
    """Importing a module sets it as an attribute of its package, even over a name of that package."""
    for stub in STUBS.values():
        for module in offered(stub).values():
            import_module(module)
    packages = [sys.modules[name_of(stub)] for stub in STUBS.values()]
    assert not [(p, n) for p in packages for n in p.__all__ if isinstance(getattr(p, n), ModuleType)]


def test_packages_import_nothing_in_their_init() -> None:
    """A module loads what it needs, not what its neighbours need."""
    program = (
        "import sys; from importlib import import_module;"
        f"packages = {[name_of(stub) for stub in STUBS]};"
        "[import_module(package) for package in packages];"
        "print(sorted(m for m in sys.modules if m.startswith('jointid') and m not in packages))"
    )
    assert printed(program) == "[]"
