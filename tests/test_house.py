"""The house stays a house: floors, rooms, sizes, and a README whose tree is the tree."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src" / "elfslam"
FLOORS = {
    "base": 0,
    "line": 1,
    "workers": 1,
    "parameters": 1.25,
    "hearing": 1.5,
    "slam": 2,
    "merging": 2.5,
    "world": 3,
    "learn": 3,
    "baselines": 3,
    "data": 3,
    "score": 3,
    "nearest": 3,
    "senses": 3.25,
    "mapping": 3.5,
    "mapping_many": 3.6,
    "exporting": 3.5,
    "joining": 3.75,
    "plans": 3.75,
    "following": 3.8,
    "console": 3.5,
    "studies": 4,
    "serve": 4,
    "cli": 5,
}
ONLY_IN = {
    "torch": {"learn"},
    "fastapi": {"serve"},
    "plotly": {"score"},
    "ray": {"workers"},
    "faiss": {"nearest"},
    "matplotlib": set[str](),
}
BASE_MAY_IMPORT = {"numpy", "elfslam"}
MOST_FILE_LINES = 400
MOST_FUNCTION_LINES = 60
MEDIAN_FUNCTION_LINES = 12


def source_files() -> list[Path]:
    return sorted(path for path in PACKAGE.rglob("*.py") if "vendor" not in path.parts)


def room_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported_modules(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            yield node.module or ""
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def import_offences(path: Path, tree: ast.AST) -> list[str]:
    """What is wrong with the imports of one file."""
    room, offences = room_of(path), []
    for module in imported_modules(tree):
        parts = module.split(".")
        if parts[0] in ONLY_IN and room not in ONLY_IN[parts[0]]:
            offences.append(f"{room} imports {parts[0]}")
        if parts[0] != "elfslam" or len(parts) < 2 or parts[1] not in FLOORS:
            continue
        other = parts[1]
        if other != room and FLOORS[other] >= FLOORS[room]:
            offences.append(f"{room} imports {other}")
        if other == room == "line" and len(parts) > 2 and parts[2] != stage_of(path):
            offences.append(f"stage {stage_of(path)} imports stage {parts[2]}")
    return offences


def stage_of(path: Path) -> str:
    """The stage of a file of line/: its name, or the folder that holds the files of one stage."""
    return path.relative_to(PACKAGE / "line").parts[0].removesuffix(".py")


@pytest.mark.parametrize("path", source_files(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_down_and_rooms_keep_to_themselves(path: Path) -> None:
    if path != PACKAGE / "__init__.py":
        assert room_of(path) in FLOORS, "a room that the house does not know"
    assert import_offences(path, ast.parse(path.read_text())) == []


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("line/echo/cut.py", "from elfslam.world.room import Room"),
        ("line/echo/cut.py", "from elfslam.line import graph"),
        ("line/echo/cut.py", "from elfslam.line.graph import optimise"),
        ("line/graph/solve.py", "from elfslam.line.closure import find_closures"),
        ("line/echo/cut.py", "from elfslam.line.motion.level import level"),
        ("line/motion/heading.py", "from elfslam.line.echo import extract_echoes"),
        ("world/room.py", "import elfslam.learn.loss"),
        ("data/runs.py", "import torch.nn"),
        ("cli/maps.py", "from plotly import graph_objects"),
        ("slam.py", "from elfslam import data"),
    ],
)
def test_the_gate_notices(file: str, text: str) -> None:
    assert import_offences(PACKAGE / file, ast.parse(text)) != []


def test_files_of_one_stage_may_import_each_other() -> None:
    text = "from elfslam.line.graph.solve import solve"
    assert import_offences(PACKAGE / "line/graph/optimise.py", ast.parse(text)) == []


def test_base_needs_numpy_and_the_standard_library_only() -> None:
    import sys

    for path in (PACKAGE / "base").glob("*.py"):
        for module in imported_modules(ast.parse(path.read_text())):
            top = module.split(".")[0]
            assert top in BASE_MAY_IMPORT or top in sys.stdlib_module_names, (
                f"{path.name}: {module}"
            )


def function_sizes() -> dict[str, int]:
    sizes = {}
    for path in source_files():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                assert node.end_lineno is not None
                sizes[f"{path.name}:{node.name}"] = node.end_lineno - node.lineno + 1
    return sizes


def test_files_and_functions_are_small() -> None:
    long_files = [
        p.name for p in source_files() if len(p.read_text().splitlines()) > MOST_FILE_LINES
    ]
    sizes = function_sizes()
    assert long_files == []
    assert [name for name, size in sizes.items() if size > MOST_FUNCTION_LINES] == []
    assert sorted(sizes.values())[len(sizes) // 2] <= MEDIAN_FUNCTION_LINES


def test_no_function_takes_a_boolean_by_position() -> None:
    offences = []
    for path in source_files():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef):
                positional = [*node.args.posonlyargs, *node.args.args]
                offences += [
                    f"{path.name}:{node.name}({argument.arg})"
                    for argument in positional
                    if isinstance(argument.annotation, ast.Name)
                    and argument.annotation.id == "bool"
                ]
    assert offences == []


def test_nothing_pickles() -> None:
    for path in source_files():
        text = path.read_text()
        assert not re.search(r"import pickle|allow_pickle=True", text), path.name
        assert "weights_only=False" not in text


def tree_in_readme() -> set[str]:
    """Names in the README's tree that end in .py or /, as paths inside the package."""
    block = re.search(r"```\nsrc/elfslam/\n(.*?)```", (ROOT / "README.md").read_text(), re.S)
    assert block, "README.md prints the tree of src/elfslam/"
    paths, folder = set(), ""
    for line in block[1].splitlines():
        match = re.match(r"( +)(\S+)", line)
        if match is None:
            continue
        if len(match[1]) == 2:
            folder = match[2] if match[2].endswith("/") else ""
            paths.add(match[2])
        else:
            paths.add(folder + match[2])
    return paths


def test_the_tree_in_the_readme_is_the_tree() -> None:
    actual = set()
    for path in source_files():
        inside = path.relative_to(PACKAGE)
        if len(inside.parts) > 1:
            actual.add(inside.parts[0] + "/")
        if len(inside.parts) > 2:
            actual.add("/".join(inside.parts[:2]) + "/")
        elif path.name != "__init__.py":
            actual.add("/".join(inside.parts))
    actual |= {"weights/", "serve/pages/"}
    assert tree_in_readme() == actual
