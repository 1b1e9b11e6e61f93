"""How large the project is, now and at other commits: what a reader has to hold.

    python -m studies.sizes [COMMIT ...]

Lines of Python, share of import lines, names of our own imported, modules of the pages, words of
docs, and decimals typed by hand: outside code, and outside the blocks that are rendered.
"""

from __future__ import annotations

import ast
import io
import re
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from elfslam.app.console import print_rows
from studies.render import BLOCK
from studies.results import ROOT

DECIMAL = re.compile(r"(?<![\w./-])\d+\.\d+(?![\w./-]*\w)")
CODE = re.compile(r"^(```|~~~).*?^\1|`[^`\n]*`", re.S | re.M)


def sizes(root: Path) -> dict[str, float]:
    """The figures of a tree, by what they are."""
    package = sorted((root / "src").rglob("*.py"))
    imports = [node for file in package for node in _imports(file)]
    lines = _lines(package)
    docs = [root / "README.md", *(root / "docs").rglob("*.md")]
    explained = [root / "README.md", *(root / "docs" / "explanation").glob("*.md")]
    pages = [file for file in (root / "src").rglob("*.js") if "vendor" not in file.parts]
    of_imports = sum((node.end_lineno or node.lineno) - node.lineno + 1 for node in imports)
    return {
        "files of the package": len(package),
        "lines of the package": lines,
        "lines of studies": _lines((root / "studies").rglob("*.py")),
        "lines of tests": _lines((root / "tests").rglob("*.py")),
        "import lines of the package (%)": round(100 * of_imports / lines, 1),
        "own names imported": sum(_own_names(node) for node in imports),
        "page modules": len(pages),
        "words of docs": sum(len(file.read_text("utf-8").split()) for file in docs),
        "decimals typed in README and explanation": sum(map(_typed_decimals, explained)),
        "results": sum(len(file.read_text("utf-8").splitlines()) - 1
                       for file in (root / "results").glob("*.csv")),
    }  # fmt: skip


def _typed_decimals(page: Path) -> int:
    text = CODE.sub("", BLOCK.sub("", page.read_text("utf-8")))
    return len(DECIMAL.findall(text))


def _lines(files: Iterator[Path] | Sequence[Path]) -> int:
    return sum(len(file.read_text("utf-8").splitlines()) for file in files)


def _imports(file: Path) -> Iterator[ast.Import | ast.ImportFrom]:
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node


def _own_names(node: ast.Import | ast.ImportFrom) -> int:
    is_own = isinstance(node, ast.ImportFrom) and (node.module or "").startswith("elfslam")
    return len(node.names) if is_own else 0


def main(commits: Sequence[str]) -> None:
    """Print a column for each commit, and one for the tree as it lies here."""
    columns: dict[str, dict[str, float]] = {}
    for commit in commits:
        packed = subprocess.run(
            ["git", "-C", str(ROOT), "archive", commit], check=True, capture_output=True
        ).stdout
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
