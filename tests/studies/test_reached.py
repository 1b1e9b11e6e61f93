"""What a study runs is found by name; what nobody reaches, prose, and a move, change nothing."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from studies import reached

GAIT = """
from elfslam import paces as walk
from elfslam.places import load

STEP_M = 0.7


def speed_mps():
    return STEP_M * walk.cadence_hz()


def measured(pace: Pace):
    return speed_mps(), load()


STUDY = measured
"""
PROJECT = {
    "studies/gait.py": GAIT,
    "src/elfslam/__init__.py": "",
    "src/elfslam/paces.py": "class Pace:\n    LAZY = 1\n\n\ndef cadence_hz():\n    return 1.9\n\n\n"
                            "def told():\n    return Pace()\n",
    "src/elfslam/places.py": "from elfslam.tables import load\n",
    "src/elfslam/tables.py": 'def load():\n    return "towns"\n',
    "src/elfslam/towns/hall.toml": "width_m = 40\n",
    "src/elfslam/weights/compact.onnx": "weights",
}  # fmt: skip
GAIT_FILE, PACES = "studies/gait.py", "src/elfslam/paces.py"
TABLES, HALL = "src/elfslam/tables.py", "src/elfslam/towns/hall.toml"


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A project of three modules and a data file, committed."""
    for file, text in PROJECT.items():
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text(text)
    monkeypatch.setattr(reached, "ROOT", tmp_path)
    monkeypatch.setattr(reached, "ENCODER", tmp_path / "src/elfslam/weights/compact.onnx")
    name = ("-c", "user.name=a", "-c", "user.email=a@b")
    for command in (("init", "-q"), ("add", "."), (*name, "commit", "-qm", "one")):
        subprocess.run(["git", "-C", str(tmp_path), *command], check=True)
    forget()
    yield tmp_path
    forget()


def forget() -> None:
    """What was read of a project."""
    for each in (reached.reached, reached.source, reached.code_of, reached.digest,
                 reached._file_of, reached._changed_files, reached._code_then):  # fmt: skip
        each.cache_clear()


def changed(root: Path, file: str, before: str, after: str) -> list[str]:
    """What the study runs that changed since the commit, once a text in a file is another."""
    text = (root / file).read_text()
    assert before in text
    (root / file).write_text(text.replace(before, after))
    forget()
    return reached.changed_since("HEAD", "studies.gait")


def test_a_module_reaches_what_it_names_and_the_data_beside(root: Path) -> None:
    found = {f"{each.file}:{each.name}" for each in reached.reached("studies.gait") if each.name}
    assert found == {
        *(f"{GAIT_FILE}:{name}" for name in ("STEP_M", "speed_mps", "measured")),
        f"{PACES}:cadence_hz", f"{TABLES}:load",
    }  # fmt: skip
    assert reached.Definition(HALL, reached.ON_IMPORT) in reached.reached("studies.gait")


@pytest.mark.parametrize(
    ("file", "before", "after", "expected"),
    [
        (GAIT_FILE, "0.7", "0.8", f"{GAIT_FILE}:STEP_M"),
        (PACES, "1.9", "2.0", f"{PACES}:cadence_hz"),
        (HALL, "40", "50", f"{HALL}:"),
        (PACES, "class Pace", "import os\nos.nice(1)\nclass Pace", f"{PACES}:"),
        (PACES, "LAZY = 1", "LAZY = 2", ""),
        (GAIT_FILE, "STUDY = measured", "STUDY = measured, 'How fast?'", ""),
        (PACES, "def cadence_hz():\n", 'def cadence_hz():\n    """Of steps."""\n', ""),
        (GAIT_FILE, "STEP_M = 0.7", "STEP_M = (\n    0.7  # m\n)", ""),
        (GAIT_FILE, "pace: Pace", "pace: int", f"{GAIT_FILE}:measured"),
    ],
)  # fmt: skip
def test_what_the_study_runs_makes_it_stale_and_nothing_else(
    root: Path, file: str, before: str, after: str, expected: str
) -> None:
    digest = reached.digest("studies.gait")
    assert changed(root, file, before, after) == ([expected] if expected else [])
    assert (reached.digest("studies.gait") == digest) == (not expected)


def test_a_move_and_new_data_change_nothing(root: Path) -> None:
    digest = reached.digest("studies.gait")
    (root / "src/elfslam/files.py").write_text((root / TABLES).read_text())
    (root / "src/elfslam/towns/tower.toml").write_text("width_m = 9\n")
    assert changed(root, "src/elfslam/places.py", "tables", "files") == []
    assert changed(root, GAIT_FILE, "def speed_mps", "def speed_mps") == []
    assert reached.digest("studies.gait") != digest, "more data may change a walk"


def test_another_encoder_is_another_digest(root: Path) -> None:
    digest = reached.digest("studies.gait")
    reached.ENCODER.write_text("other")
    forget()
    assert reached.digest("studies.gait") != digest


def test_of_an_unknown_commit_everything_has_changed(root: Path) -> None:
    assert f"{TABLES}:load" in reached.changed_since("0" * 40, "studies.gait")
    assert reached.changed_since("HEAD", "studies.gait") == []


def test_a_study_here_reaches_the_simulator_but_no_server() -> None:
    files = {each.file for each in reached.reached("studies.mapping")}
    assert {"src/elfslam/world/simulate.py", "src/elfslam/world/worlds/mall.toml"} <= files
    assert not any(file.startswith("src/elfslam/serve") for file in files)
