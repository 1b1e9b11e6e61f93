"""A verb imports what it needs, and nothing of the others."""

import subprocess
import sys

HEAVY = ("torch", "gtsam", "plotly", "sklearn", "fastapi", "ray", "faiss")


def imported_by(code: str) -> set[str]:
    """Which modules a fresh interpreter has after running `code`."""
    told = f"{code}\nimport sys\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_help_imports_no_numbers_even() -> None:
    found = imported_by("from elfslam.cli.app import run\nrun(['--help'])")
    assert not {"numpy", "scipy", "numba", "onnxruntime", *HEAVY} & found


def test_light_verbs_import_nothing_heavy() -> None:
    light = ["locate", "import", "parameters", "marks", "phyphox"]
    found = imported_by(f"from elfslam.cli.app import verb_of\nfor verb in {light}: verb_of(verb)")
    assert not set(HEAVY) & found


def test_the_door_imports_on_first_use() -> None:
    assert not {"numpy", "scipy", *HEAVY} & imported_by("import elfslam\ndir(elfslam)")
    found = imported_by("import elfslam\nelfslam.locate, elfslam.read_recording")
    assert not set(HEAVY) & found
