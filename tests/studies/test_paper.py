"""The paper's recipe, small: every figure has its row and the ratio is that of the two."""

from __future__ import annotations

from pathlib import Path

import pytest

from elfslam.learn.parameters import PretrainParameters, ScratchParameters
from elfslam.line.feature import load_encoder
from elfslam.scoring.page import save_page
from studies import paper
from studies.finding import Finding, Given
from studies.paper import CHANGES, PAPER_M, WORLDS, measure_paper, paper_rows


def test_a_figure_within_a_factor_of_two_is_told() -> None:
    walks = [
        {"one-shot": 0.1, "mapping, plain spectrogram": 0.3},
        {"one-shot": 0.2, "mapping, plain spectrogram": 0.5},
    ]
    rows = {row["figure"]: row for row in paper_rows({"living_room": walks})}
    assert rows["one-shot"]["ours (m)"] == 0.15
    assert rows["one-shot"]["ours over paper"] == 1.5
    assert rows["one-shot"]["within a factor of two"] is True
    assert rows["mapping, plain spectrogram"]["within a factor of two"] is None
    [far] = paper_rows({"office": [{"one-shot": 0.2}]})
    assert far["within a factor of two"] is False


def test_walks_without_an_answer_count_for_nothing() -> None:
    [row] = paper_rows({"office": [{"one-shot": 0.5}, {"one-shot": float("nan")}]})
    assert (row["ours (m)"], row["walks"]) == (0.5, 1)


def test_what_the_paper_tells_is_of_its_places() -> None:
    assert {world for figures in PAPER_M.values() for world in figures} == set(WORLDS)
    assert set(CHANGES) <= set(PAPER_M)


def shipped_as_pretrained(file: Path, *_: object) -> None:
    """What is trained for an hour stands for what is trained for a quarter."""
    file.write_bytes(load_encoder("compact").content)


def test_a_recipe_is_trained_once_and_another_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trained: list[Path] = []

    def train(file: Path, *_: object) -> None:
        file.parent.mkdir(exist_ok=True)
        file.touch()
        trained.append(file)

    monkeypatch.setattr("studies.paper_training.pretrain_as_in_paper", train)
    monkeypatch.setattr(paper, "finished", lambda *_: [])
    given = Given(kept=tmp_path / "paper.partial")
    for steps in (2, 2, 3):
        measure_paper(given, worlds=(), pretraining=PretrainParameters(steps=steps))
    assert len(trained) == len(set(trained)) == 2
    assert {file.parent for file in trained} == {tmp_path / "encoders"}


@pytest.fixture(scope="module")
def finding() -> Finding:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(paper, "PAPER_M", {name: {"studio": 1.0} for name in PAPER_M})
        patch.setattr("studies.paper_training.pretrain_as_in_paper", shipped_as_pretrained)
        quick = ScratchParameters(steps=2, pairs=16, threads=1)
        return measure_paper(Given(), worlds=("studio",), seeds=(100,), rounds=3, scratch=quick)


@pytest.mark.real
def test_every_figure_has_a_row(finding: Finding, tmp_path: Path) -> None:
    rows = {row["figure"]: float(str(row["ours (m)"])) for row in finding.rows}
    assert set(rows) == {*PAPER_M, "mapping, plain spectrogram"}
    assert rows["mapping"] < 0.3
    assert rows["opposite heading"] > 5 * rows["one-shot"]
    assert finding.page is not None
    save_page(tmp_path / "page.html", finding.page)
