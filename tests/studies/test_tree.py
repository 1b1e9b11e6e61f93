"""The page of the tree, of a planted house."""

from pathlib import Path

from studies.tree import first_line, tree_page


def plant(file: Path, text: str) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)


def test_rooms_come_by_floor_and_folders_before_what_lies_in_them(tmp_path: Path) -> None:
    house = tmp_path / "src" / "elfslam"
    plant(house / "app" / "__init__.py", '"""Floor 4: verbs."""\n')
    plant(house / "stages" / "__init__.py", '"""Floor 2: the method."""\n')
    plant(house / "stages" / "echo" / "__init__.py", '"""Echo cutting."""\n')
    plant(house / "stages" / "echo" / "cut.py", '"""Cuts.\n\nMore of it.\n"""\n')
    plant(tmp_path / "studies" / "__init__.py", '"""Tables."""\n')
    page = tree_page(tmp_path)
    places = [
        page.index(text)
        for text in (
            "## src/elfslam/stages/",
            "Floor 2: the method.",
            "| **`echo/`** | Echo cutting. |",
            "| `echo/cut.py` | Cuts. |",
            "## src/elfslam/app/",
            "## studies/",
        )
    ]
    assert places == sorted(places)
    assert "More of it" not in page


def test_a_bar_in_a_first_line_ends_no_cell(tmp_path: Path) -> None:
    plant(tmp_path / "a.py", '"""RUN|MAP."""\n')
    plant(tmp_path / "b.py", "")
    assert first_line(tmp_path / "a.py") == "RUN\\|MAP."
    assert first_line(tmp_path / "b.py") == ""
