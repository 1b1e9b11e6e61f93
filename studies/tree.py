"""The page of the tree of files, made from the first lines of docstrings: `python -m studies.tree`.

`make docs` writes it into docs/reference/, where it is not committed.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "reference" / "tree.md"
HEAD = """# The tree of files

Every module with the first line of its docstring, made by `python -m studies.tree`. How the rooms
depend on each other: [architecture](../explanation/architecture.md). The pages in the browser,
`serve/pages/`, are JavaScript and stand for themselves.
"""


def main() -> None:
    """Write the page."""
    PAGE.write_text(tree_page(ROOT), encoding="utf-8")


def tree_page(root: Path) -> str:
    """The page for the package and the studies below `root`."""
    package = root / "src" / "elfslam"
    rooms = [init.parent for init in package.glob("*/__init__.py")]
    rooms.sort(key=lambda room: (first_line(room / "__init__.py").partition(":")[0], room.name))
    sections = [section(f"src/elfslam/{room.name}/", room) for room in rooms]
    return "\n".join([HEAD, *sections, section("studies/", root / "studies")])


def section(title: str, folder: Path) -> str:
    """One room: what it is, and a row for each of its modules and folders."""
    rows = [f"| {name} | {line} |" for name, line in modules(folder)]
    return "\n".join(
        [f"## {title}\n", f"{first_line(folder / '__init__.py')}\n", *TABLE, *rows, ""]
    )


TABLE = ("| file | what |", "|---|---|")


def modules(folder: Path) -> Iterator[tuple[str, str]]:
    """Name and first line of each module below a folder, a folder before what lies in it."""
    for path in sorted(folder.rglob("*.py"), key=lambda path: path.relative_to(folder).parts):
        inside = path.relative_to(folder)
        if path.name != "__init__.py":
            yield f"`{inside.as_posix()}`", first_line(path)
        elif len(inside.parts) > 1:
            yield f"**`{inside.parent.as_posix()}/`**", first_line(path)


def first_line(path: Path) -> str:
    """The first line of a module's docstring, as a cell of a table; empty where there is none."""
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return text.partition("\n")[0].replace("|", "\\|")


if __name__ == "__main__":
    main()
