"""The house keeps its floors: a lower room never imports a higher one, and each heavy library has its own room."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "fbgraph"
VIEWING = {"recording", "scene", "rrd", "blueprint", "side_by_side", "live_view"}
LAYERS = {
    0: {"errors", "config", "geometry", "georeference", "log", "checkpoints", "trajectory", "palette"},
    1: {"readers", "simulate", "routes", "gait", "attitude", "rests", "steps", "field", "sources"},
    2: {
        "pdr",
        "ekf",
        "graph",
        "residuals",
        "smoother",
        "online",
        "closures",
        "turnback",
        "outbound",
        "matching",
        "result",
    },
    3: {"metrics", "turns", "guidance", "way_texts", "way_maps", "returning", "findings", "exports", "runs", *VIEWING},
    4: {"pipeline", "session", "reruns", "batch", "study", "cli"},
}
LEVEL = {room: level for level, rooms in LAYERS.items() for room in rooms}
MODULES = sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def room(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def called(path: Path) -> set[str]:
    calls = (node.func for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.Call))
    return {ast.unparse(function) for function in calls}


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_room_imports_a_higher_one(path: Path) -> None:
    assert room(path) in LEVEL, "a new room: give it a floor above"
    used = {name.split(".")[1] for name in imports(path) if name.startswith("fbgraph.") and "." in name}
    higher = {name for name in used & set(LEVEL) if LEVEL[name] > LEVEL[room(path)]}
    assert not higher


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_heavy_libraries_stay_in_their_rooms(path: Path) -> None:
    used = {name.split(".")[0] for name in imports(path)}
    assert "gtsam" not in used or LEVEL[room(path)] == 2
    where = path.relative_to(PACKAGE).as_posix()
    assert "rerun" not in used or room(path) in VIEWING or where == "study/recording.py"
    assert "matplotlib" not in used or where == "study/figures.py"
    if room(path) != "cli":
        assert not {"print", "sys.exit", "exit", "typer.Exit"} & called(path)
