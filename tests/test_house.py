"""The house keeps its order: rooms import only rooms before them, heavy libraries stay where they belong."""

import ast
import functools
import subprocess
import sys
from pathlib import Path

import pytest

import fbgraph

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "fbgraph"
FLOOR = {room: floor for floor, room in enumerate(fbgraph.ROOMS)}
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for path in sorted(PACKAGE.rglob("*.py"))
}
INSIDE = [name for name in MODULES if name not in ("fbgraph", "fbgraph.__main__")]  # these two hand on what others are
SOURCES = [*MODULES.values(), *(ROOT / "tests").rglob("*.py"), *(ROOT / "scripts").glob("*.py")]


def room(module: str) -> str:
    return module.split(".")[1]


def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


@functools.cache
def imported(module: str) -> frozenset[str]:
    """Everything that a module names in import statements, wherever they stand."""
    names: set[str] = set()
    for node in ast.walk(tree(MODULES[module])):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(names)


@functools.cache
def ours(module: str) -> frozenset[str]:
    """Modules of the package that a module imports."""
    names = (name if name in MODULES else name.rpartition(".")[0] for name in imported(module))
    return frozenset(name for name in names if name in MODULES and name not in ("fbgraph", module))


@functools.cache
def chain(module: str) -> tuple[str, ...]:
    return max(((module, *chain(other)) for other in ours(module)), key=len, default=(module,))


@pytest.mark.parametrize("module", INSIDE)
def test_no_room_imports_a_later_one(module: str) -> None:
    assert room(module) in FLOOR, "a new room: name it in fbgraph.ROOMS"
    later = {other for other in ours(module) if FLOOR[room(other)] > FLOOR[room(module)]}
    assert not later


@pytest.mark.parametrize("module", INSIDE)
def test_heavy_libraries_stay_in_their_rooms(module: str) -> None:
    used = {name.split(".")[0] for name in imported(module)}
    assert "gtsam" not in used or room(module) == "estimators"
    assert "rerun" not in used or room(module) == "recording" or module == "fbgraph.study.study_recording"
    assert not {"mcap", "mcap_protobuf", "foxglove_schemas_protobuf"} & used or room(module) == "exports"
    assert "pyarrow" not in used or room(module) in ("tables", "exports", "recording")
    gpx = ("fbgraph.readers.places", "fbgraph.way_back.gpx_geojson")
    assert "gpxpy" not in used or room(module) == "exports" or module in gpx
    assert "matplotlib" not in used or room(module) == "plots" or module == "fbgraph.study.figures"
    assert "typer" not in used or room(module) == "cli"
    assert not {"pebble", "multiprocessing", "distributed", "dask"} & used or room(module) == "workers"


@pytest.mark.parametrize("module", [name for name in INSIDE if room(name) != "cli"])
def test_only_the_command_line_prints_or_exits(module: str) -> None:
    calls = {ast.unparse(node.func) for node in ast.walk(tree(MODULES[module])) if isinstance(node, ast.Call)}
    assert not {"print", "sys.exit", "exit", "typer.Exit"} & calls


def test_a_chain_of_imports_has_an_end() -> None:
    longest = max((chain(module) for module in INSIDE), key=len)
    assert len(longest) <= 14, " -> ".join(longest)


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_files_and_functions_can_be_read_at_one_sitting(path: Path) -> None:
    assert len(path.read_text("utf-8").splitlines()) <= 400
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.FunctionDef):
            first = node.body[ast.get_docstring(node) is not None :]
            assert not first or (node.end_lineno or 0) - first[0].lineno + 1 <= 60, node.name


@pytest.mark.parametrize("room", [room for room in fbgraph.ROOMS if (PACKAGE / room).is_dir()])
def test_every_room_has_its_tests(room: str) -> None:
    assert list((ROOT / "tests" / room).glob("test_*.py"))


def loaded(code: str) -> set[str]:
    """Top names of the modules that a fresh process has loaded after some code."""
    code = f"{code}\nimport sys; print(*{{name.split('.')[0] for name in sys.modules}})"
    return set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split())


@pytest.mark.parametrize(
    "module", ["fbgraph.run.read_run", "fbgraph.way_back.gpx_geojson", "fbgraph.run.scores", "fbgraph.exports.mcap"]
)
def test_who_reads_a_run_loads_no_solver(module: str) -> None:
    assert not {"gtsam", "vqf", "rerun"} & loaded(f"import {module}")


def test_importing_the_package_loads_nothing() -> None:
    assert not {"numpy", "pandas", "gtsam", "pydantic", "typer"} & loaded("import fbgraph")
