"""The house stays a house: twelve rooms on six whole floors, imports that go down, small functions.

`python tests/test_house.py` prints the rooms, their floors and the arrows between them.
"""

import ast
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src" / "elfslam"
STUDIES = ROOT / "studies"
FLOORS = {
    "base": 1,
    "stages": 2,
    "slam": 3,
    "data": 3,
    "scoring": 3,
    "world": 3,
    "learn": 3,
    "baselines": 3,
    "app": 4,
    "serve": 5,
    "cli": 6,
    "studies": 6,
}
ONLY_IN = {
    "torch": {"learn", "studies"},
    "fastapi": {"serve"},
    "plotly": {"scoring"},
    "sklearn": {"studies"},
    "gtsam": {"stages", "studies"},
    "ray": {"app"},
    "faiss": {"serve"},
    "paho": {"serve"},
    "matplotlib": {"studies"},
}
DOOR = {"base", "stages", "slam", "data", "app"}
"""What `import elfslam` gives stands in these rooms: the package's own file hands it on."""
BASE_MAY_IMPORT = {"numpy", "elfslam"}
NAMED_TWICE = {
    "Building": "the floors of one and their passages, and the row of the database with its name",
    "Recording": "the walk, and the row of the database that says where its files lie",
}
"""Public classes that share a name, each with the reason why."""
SMALL_LINES = 60
MOST_IMPORT_SHARE = 0.075
"""Of the package's lines; 0.07 is wanted."""
MOST_FUNCTION_LINES = 60
MEDIAN_FUNCTION_LINES = 12


def source_files() -> list[Path]:
    files = [*PACKAGE.rglob("*.py"), *STUDIES.rglob("*.py")]
    return sorted(path for path in files if "vendor" not in path.parts)


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def room_of(path: Path) -> str:
    """The room a file stands in; what stands at the package root is a room that nobody knows."""
    inside = path.relative_to(ROOT if path.is_relative_to(STUDIES) else PACKAGE)
    return inside.parts[0]


def imported_modules(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            yield node.module or ""
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def imported_rooms(tree: ast.AST) -> set[str]:
    rooms = set()
    for module in imported_modules(tree):
        first, _, rest = module.partition(".")
        rooms.add("studies" if first == "studies" else rest.split(".")[0] * (first == "elfslam"))
    return rooms & set(FLOORS)


def import_offences(path: Path, tree: ast.AST) -> list[str]:
    """What is wrong with the imports of one file."""
    room, offences = room_of(path), []
    for module in imported_modules(tree):
        parts = module.split(".")
        if parts[0] in ONLY_IN and room not in ONLY_IN[parts[0]]:
            offences.append(f"{room} imports {parts[0]}")
        stage = parts[2] if parts[:2] == ["elfslam", "stages"] and len(parts) > 2 else ""
        if room == "stages" and stage not in ("", stage_of(path)):
            offences.append(f"stage {stage_of(path)} imports stage {stage}")
    for other in imported_rooms(tree) - {room}:
        if FLOORS[other] >= FLOORS[room]:
            offences.append(f"{room} imports {other}")
    return offences


def stage_of(path: Path) -> str:
    """The stage of a file of stages/: its name, or the folder that holds the files of one stage."""
    return path.relative_to(PACKAGE / "stages").parts[0].removesuffix(".py")


def arrows() -> dict[str, set[str]]:
    """Which rooms each room imports."""
    found: dict[str, set[str]] = {room: set() for room in FLOORS}
    for path in source_files():
        if (room := room_of(path)) in FLOORS:
            found[room] |= imported_rooms(parsed(path)) - {room}
    return found


def test_imports_go_down_and_rooms_keep_to_themselves() -> None:
    door = PACKAGE / "__init__.py"
    assert imported_rooms(parsed(door)) <= DOOR
    files = [path for path in source_files() if path != door]
    loose = [path.name for path in files if room_of(path) not in FLOORS]
    assert loose == [], "a module stands in a room, never at the package root"
    assert [f"{at}: {what}" for at in files for what in import_offences(at, parsed(at))] == []


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("stages/echo/cut.py", "from elfslam.world.room import Room"),
        ("stages/echo/cut.py", "from elfslam.stages import graph"),
        ("stages/echo/cut.py", "from elfslam.stages.motion.level import level"),
        ("world/room.py", "import elfslam.learn.loss"),
        ("data/runs.py", "import torch.nn"),
        ("slam/pipeline.py", "from elfslam import data"),
    ],
)
def test_the_gate_notices(file: str, text: str) -> None:
    assert import_offences(PACKAGE / file, ast.parse(text)) != []


def test_files_of_one_stage_may_import_each_other() -> None:
    text = "from elfslam.stages.graph.building import build_graph"
    assert import_offences(PACKAGE / "stages/graph/solving.py", ast.parse(text)) == []


def import_share() -> float:
    """Which share of the package's lines are imports."""
    imports = lines = 0
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text()
        nodes = ast.walk(ast.parse(text))
        lines += len(text.splitlines())
        imports += sum(
            (node.end_lineno or node.lineno) - node.lineno + 1
            for node in nodes
            if isinstance(node, ast.Import | ast.ImportFrom)
        )
    return imports / lines


def test_few_lines_are_imports() -> None:
    assert import_share() <= MOST_IMPORT_SHARE


def importers() -> dict[Path, set[Path]]:
    """The modules of the package, and which others import each."""
    modules = {
        ".".join(path.relative_to(ROOT / "src").with_suffix("").parts): path
        for path in PACKAGE.rglob("*.py")
        if path.name != "__init__.py"
    }
    found: dict[Path, set[Path]] = {path: set() for path in modules.values()}
    for path in PACKAGE.rglob("*.py"):
        for module in imported_modules(parsed(path)):
            if module in modules:
                found[modules[module]].add(path)
    return found


def test_a_small_module_with_one_importer_beside_it_is_part_of_that() -> None:
    alone = {
        str(path.relative_to(PACKAGE))
        for path, who in importers().items()
        if len(path.read_text().splitlines()) < SMALL_LINES
        and len(beside := {each for each in who if each.name != "__init__.py"}) == 1
        and {each.parent for each in beside} == {path.parent}
    }
    assert alone == set()


def test_base_needs_numpy_and_the_standard_library_only() -> None:
    for path in (PACKAGE / "base").glob("*.py"):
        for module in imported_modules(parsed(path)):
            top = module.split(".")[0]
            known = top in BASE_MAY_IMPORT or top in sys.stdlib_module_names
            assert known, f"{path.name}: {module}"


def test_every_package_says_its_floor() -> None:
    for room, floor in FLOORS.items():
        if room not in ("studies", "cli"):
            text = (PACKAGE / room / "__init__.py").read_text()
            assert text.startswith(f'"""Floor {floor}: '), room


def function_sizes() -> dict[str, int]:
    sizes = {}
    for path in source_files():
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                assert node.end_lineno is not None
                sizes[f"{path.name}:{node.name}"] = node.end_lineno - node.lineno + 1
    return sizes


def test_functions_are_small() -> None:
    sizes = function_sizes()
    assert [name for name, size in sizes.items() if size > MOST_FUNCTION_LINES] == []
    assert sorted(sizes.values())[len(sizes) // 2] <= MEDIAN_FUNCTION_LINES


def test_no_function_takes_a_boolean_by_position() -> None:
    offences = []
    for path in source_files():
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.FunctionDef):
                positional = [*node.args.posonlyargs, *node.args.args]
                offences += [
                    f"{path.name}:{node.name}({argument.arg})"
                    for argument in positional
                    if isinstance(argument.annotation, ast.Name)
                    and argument.annotation.id == "bool"
                ]
    assert offences == []


def public_classes(text: str) -> list[str]:
    """Names of the public classes of a module."""
    nodes = ast.parse(text).body
    return [
        node.name
        for node in nodes
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    ]


def named_twice(texts: Iterable[str]) -> set[str]:
    """Names that public classes of these modules share."""
    names = Counter(name for text in texts for name in public_classes(text))
    return {name for name, times in names.items() if times > 1}


def test_one_name_means_one_class() -> None:
    assert named_twice(path.read_text() for path in PACKAGE.rglob("*.py")) == set(NAMED_TWICE)


def test_text_files_are_utf_8_in_every_locale() -> None:
    rule = ("--isolated", "--no-cache", "--preview", "--select", "PLW1514")
    command = [sys.executable, "-m", "ruff", "check", *rule, str(PACKAGE)]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stdout


def test_nothing_pickles() -> None:
    for path in source_files():
        text = path.read_text()
        assert not re.search(r"import pickle|allow_pickle=True", text), path.name
        assert "weights_only=False" not in text


def main() -> None:
    """Print the house: rooms from the ground up, and what each imports."""
    found = arrows()
    for room, floor in FLOORS.items():
        folder = STUDIES if room == "studies" else PACKAGE / room
        files = [path for path in source_files() if path.is_relative_to(folder)]
        lines = sum(len(path.read_text().splitlines()) for path in files)
        below = ", ".join(sorted(found[room])) or "nothing"
        print(f"floor {floor}  {room:10} {len(files):4} files {lines:6} lines  imports {below}")
    loose = [path.name for path in PACKAGE.glob("*.py") if path.name != "__init__.py"]
    count = sum(len(below) for below in found.values())
    print(
        f"{len(FLOORS)} rooms on {len(set(FLOORS.values()))} floors, {count} arrows, "
        f"{len(loose)} loose modules"
    )


if __name__ == "__main__":
    main()
