"""The notebooks of examples/ run, cell by cell, and what they end with is as they say."""

import json
from pathlib import Path
from typing import Any

import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def run_cells(name: str) -> dict[str, Any]:
    """What the code cells of a notebook define."""
    cells = json.loads((EXAMPLES / name).read_text(encoding="utf-8"))["cells"]
    defined: dict[str, Any] = {}
    for number, cell in enumerate(cells):
        if cell["cell_type"] == "code":
            assert cell["outputs"] == [], "notebooks are kept without what they printed"
            exec(compile("".join(cell["source"]), f"{name}, cell {number}", "exec"), defined)
    return defined


@pytest.mark.real
def test_a_walk_is_mapped_and_another_located_in_it() -> None:
    defined = run_cells("map_and_locate.ipynb")
    assert defined["run"].trajectory.status == "OK"
    assert len(defined["floor_map"].sources) == 2
    assert (defined["fixes"].status == 0).mean() > 0.9


@pytest.mark.real
def test_an_encoder_and_a_similarity_of_ones_own_map_as_well() -> None:
    defined = run_cells("your_own_stage.ipynb")
    mine, joint = defined["mine"], defined["joint"]
    assert mine.similarity.kind == "elf:root-spectrum-1"
    assert joint.similarity.kind == "elf beside root spectrum"
    for run in (mine, joint):
        errors = defined["medians_m"](run)
        assert errors["SLAM"] < errors["dead reckoning"]
