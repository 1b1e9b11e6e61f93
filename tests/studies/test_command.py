"""`python -m studies`: the table printed and written, and every bad input refused in one line."""

import json
from pathlib import Path

import pytest

from studies import __main__ as command
from studies import catalogue
from studies.__main__ import run
from studies.results import Record, read_results
from studies.study import Study, StudyContext


def gait(context: StudyContext) -> list[Record]:
    """Records of two metrics, of which one method lacks one."""
    return [Record("steps", "rate (Hz)", 1.9), Record("steps", "length (m)", 0.7),
            Record("strides", "rate (Hz)", 0.95)]  # fmt: skip


@pytest.fixture(autouse=True)
def planted(monkeypatch: pytest.MonkeyPatch) -> None:
    real = catalogue.study_named
    study = Study("How do people walk?", gait, minutes=1)
    for module in (catalogue, command):
        monkeypatch.setattr(module, "study_named", lambda at: study if at == "gait" else real(at))


def test_a_study_is_printed_and_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["gait", "--out", str(tmp_path / "out"), "--json"]) == 0
    seen = capsys.readouterr()
    assert json.loads(seen.out) == [
        {"method": "steps", "rate (Hz)": "1.9", "length (m)": "0.7"},
        {"method": "strides", "rate (Hz)": "0.95", "length (m)": ""},
    ]
    assert "about 1 min on two cores" in seen.err
    assert len(read_results(tmp_path / "out" / "gait.csv")) == 3
    assert run(["gait", "--out", str(tmp_path / "out")]) == 0
    assert "strides" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("everything --out {tmp}/out", "closures, contention"),
        ("sensors --out {tmp}/out --data {tmp}/none", "mall_walks"),
        ("gait --out {tmp}/text", "text"),
        ("gait --out {tmp}/text/below", "text"),
        ("gait --out {tmp}/out --recording {tmp}/walk", "leave --recording out"),
        ("elf --out {tmp}/out --encoder {tmp}/none.onnx", "none.onnx"),
        ("render --check --kind", "--kind"),
        ("--nonsense", "python -m studies --help"),
    ],
)
def test_bad_arguments_are_refused_in_one_line(
    line: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "text").write_text("some words\n")
    assert run(line.format(tmp=tmp_path).split()) == 2
    seen = capsys.readouterr()
    assert seen.out == ""
    assert words in seen.err.splitlines()[-1]
    assert not (tmp_path / "out" / "gait.csv").exists()
    assert (tmp_path / "text").read_text() == "some words\n"
