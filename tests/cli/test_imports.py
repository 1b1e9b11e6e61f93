"""A verb imports what it needs, and nothing of the others."""

from __future__ import annotations

import subprocess
import sys

import pytest

from elfslam.cli.app import VERBS, verb_of

HEAVY = ("torch", "gtsam", "plotly", "sklearn", "fastapi", "ray", "faiss")


def imported_by(code: str) -> set[str]:
    """Which modules a fresh interpreter has after running `code`."""
    told = f"{code}\nimport sys\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_help_imports_no_numbers_even() -> None:
    found = imported_by("from elfslam.cli.app import run\nrun(['--help'])")
    assert not {"numpy", "scipy", "numba", "onnxruntime", *HEAVY} & found


@pytest.mark.parametrize("verb", ["locate", "import", "parameters", "marks", "phyphox"])
def test_light_verbs_import_nothing_heavy(verb: str) -> None:
    found = imported_by(f"from elfslam.cli.app import verb_of\nverb_of({verb!r})")
    assert not set(HEAVY) & found


def test_the_door_imports_on_first_use() -> None:
    assert not {"numpy", "scipy", *HEAVY} & imported_by("import elfslam\ndir(elfslam)")
    found = imported_by("import elfslam\nelfslam.locate, elfslam.read_recording")
    assert not set(HEAVY) & found


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_is_there_and_says_what_it_does(verb: str) -> None:
    assert (verb_of(verb).__doc__ or "").strip().endswith(".")
