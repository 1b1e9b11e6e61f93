"""The tables of commands and parameters that the site gets."""

import pytest

from docs.hooks import (
    COMMANDS,
    PARAMETERS,
    STUDY_TABLE,
    command_section,
    on_page_markdown,
    study_table,
)
from elfslam.cli.app import VERBS
from studies.tree import ROOT

REFERENCE = ROOT / "docs" / "reference"


def test_every_verb_has_a_section() -> None:
    page = on_page_markdown((REFERENCE / "commands.md").read_text())
    assert [verb for verb in VERBS if f"\n## {verb}\n" not in page] == []
    assert COMMANDS not in page


def test_a_verb_tells_arguments_options_and_defaults() -> None:
    section = command_section("locate")
    assert "elfslam locate RECORDING MAP OUT.csv [OPTIONS]" in section
    assert "| `--seed` | Of the tracker's draws. Default: `0`. |" in section
    assert "Default: ``" not in section


def test_parameters_stand_by_group_with_value_and_unit() -> None:
    page = on_page_markdown((REFERENCE / "parameters.md").read_text())
    chirp = page.partition("\n## chirp\n")[2].partition("\n## ")[0]
    assert "| `band_low_hz` | 15000.0 | Hz | lower end of the band |" in chirp
    assert PARAMETERS not in page


def test_studies_stand_with_their_question_and_minutes() -> None:
    assert STUDY_TABLE in (ROOT / "docs" / "how-to" / "studies.md").read_text()
    table = study_table(["mapping"])
    assert len(table.splitlines()) == 3
    assert "| `mapping` | How far off are maps, by method, in the paper's three places? | " in table


@pytest.mark.parametrize("text", ["", "# A page\n\nwithout markers"])
def test_other_pages_stay(text: str) -> None:
    assert on_page_markdown(text) == text
