"""How large the project is, now and at other commits: what a reader has to hold.

    python -m studies.sizes [COMMIT ...]

The package by its pieces: rooms (`studies` is one), floors, arrows (a room that imports another),
files and lines, share of import lines, own names imported, and modules of the pages. Then studies,
tests, words of docs (all, and those written outside rendered blocks), and decimals typed by hand:
outside code, and outside rendered blocks.
"""

import ast
import io
import re
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median

from elfslam.app.console import print_rows
from studies.reached import ROOT
from studies.render import BLOCK, SUMMARY

STUDIES = "studies"
FLOOR = re.compile(r"\bfloor (\d)", re.I)
DECIMAL = re.compile(r"(?<![\w./-])\d+\.\d+(?![\w./-]*\w)")
CODE = re.compile(r"^(```|~~~).*?^\1|`[^`\n]*`", re.S | re.M)
Node = ast.Import | ast.ImportFrom


def sizes(root: Path) -> dict[str, float]:
    """The figures of a tree, by what they are."""
    package = sorted((root / "src").rglob("*.py"))
    imports = [node for file in package for node in _imports(file)]
    lengths = [_lines(file) for file in package]
    of_imports = sum((node.end_lineno or node.lineno) - node.lineno + 1 for node in imports)
    rooms = rooms_of(root)
    pages = [file for file in (root / "src").rglob("*.js") if "vendor" not in file.parts]
    docs = [root / "README.md", *(root / "docs").rglob("*.md")]
    explained = [root / "README.md", *(root / "docs" / "explanation").glob("*.md")]
    results = (root / "results").glob("*.csv")
    return {
        "rooms": len(rooms),
        "floors": len({floor for room in rooms.values() if (floor := _floor(room))}),
        "arrows between rooms": len(arrows(rooms)),
        "files": len(package),
        "lines": sum(lengths),
        "lines of the median file": median(lengths),
        "import lines (%)": round(100 * of_imports / sum(lengths), 1),
        "own names imported": sum(map(_own_names, imports)),
        "own names imported, a file": round(sum(map(_own_names, imports)) / len(package), 1),
        "page modules": len(pages),
        "lines of page modules": sum(map(_lines, pages)),
        "lines of studies": sum(map(_lines, (root / STUDIES).rglob("*.py"))),
        "lines of tests": sum(map(_lines, (root / "tests").rglob("*.py"))),
        "words of docs": sum(len(file.read_text("utf-8").split()) for file in docs),
        "written words of docs": sum(len(_written(file).split()) for file in docs),
        "decimals typed in README and explanation": sum(map(_typed_decimals, explained)),
        "results": sum(_lines(file) - 1 for file in results),
    }


def rooms_of(root: Path) -> dict[str, Path]:
    """The folders of the package that are packages, by name, and the studies."""
    inits = sorted((root / "src" / "elfslam").glob("*/__init__.py"))
    found = {init.parent.name: init.parent for init in inits}
    return found | ({STUDIES: root / STUDIES} if (root / STUDIES).is_dir() else {})


def arrows(rooms: Mapping[str, Path]) -> set[tuple[str, str]]:
    """Which room imports which other one."""
    return {
        (room, other)
        for room, folder in rooms.items()
        for file in folder.rglob("*.py")
        for node in _imports(file)
        for other in _rooms_in(node)
        if other in rooms and other != room
    }


def _rooms_in(node: Node) -> Iterator[str]:
    """The first names below the package, or the studies, that an import names."""
    if isinstance(node, ast.Import):
        names: Iterable[str] = (alias.name for alias in node.names)
    else:
        names = (f"{node.module}.{alias.name}" for alias in node.names)
    for name in names:
        first, _, rest = name.partition(".")
        if first == STUDIES:
            yield STUDIES
        elif first == "elfslam":
            yield rest.partition(".")[0]


def _floor(room: Path) -> str:
    """On which floor a room says that it stands, in its docstring; the studies stand on top."""
    text = "floor 6" if room.name == STUDIES else (room / "__init__.py").read_text("utf-8")
    found = FLOOR.search(text)
    return found[1] if found else ""


def _typed_decimals(page: Path) -> int:
    return len(DECIMAL.findall(CODE.sub("", _written(page))))


def _written(page: Path) -> str:
    """A page without what is rendered into it."""
    return SUMMARY.sub("", BLOCK.sub("", page.read_text("utf-8")))


def _lines(file: Path) -> int:
    return len(file.read_text("utf-8").splitlines())


def _imports(file: Path) -> Iterator[Node]:
    nodes = ast.walk(ast.parse(file.read_text("utf-8")))
    return (node for node in nodes if isinstance(node, Node))


def _own_names(node: Node) -> int:
    return sum(1 for _ in _rooms_in(node))


def main(commits: Sequence[str]) -> None:
    """Print a column for each commit, and one for the tree as it lies here."""
    columns: dict[str, dict[str, float]] = {}
    for commit in commits:
        command = ["git", "-C", str(ROOT), "archive", commit]
        packed = subprocess.run(command, check=True, capture_output=True).stdout
        with (
            tempfile.TemporaryDirectory() as folder,
            tarfile.open(fileobj=io.BytesIO(packed)) as tar,
        ):
            tar.extractall(folder, filter="data")
            columns[commit] = sizes(Path(folder))
    columns["now"] = sizes(ROOT)
    rows = [
        {"": name, **{commit: f"{found[name]:g}" for commit, found in columns.items()}}
        for name in columns["now"]
    ]
    print_rows(rows, title="Sizes", as_json=False)


if __name__ == "__main__":
    main(sys.argv[1:])
