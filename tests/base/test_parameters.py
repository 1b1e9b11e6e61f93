"""Parameters: who wins, what is refused, and what the refusal says."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from elfslam.base.errors import ParameterError
from elfslam.base.parameters import as_dict, digest, load, parameter, replace, rows


@dataclass(frozen=True)
class Closing:
    threshold: float = parameter(0.4, "", "least similarity", low=0.0, high=1.0)
    points: int = parameter(6, "", "fewest points", low=2)
    offset_m: float = parameter(0.0, "m", "any length", high=9.0)
    robust: bool = parameter(True, "", "reject outliers")
    kind: str = parameter("chirp", "", "excitation")
    free: float = parameter(1.0, "", "any number")


@dataclass(frozen=True)
class Groups:
    closure: Closing = field(default_factory=Closing)
    other: Closing = field(default_factory=Closing)


def test_rows_list_every_parameter_with_unit_and_meaning() -> None:
    listed = list(rows(Groups()))
    assert len(listed) == 12
    assert [row.name for row in listed][:2] == ["closure.threshold", "closure.points"]
    row = listed[8]
    told = (row.name, row.value, row.unit, row.meaning)
    assert told == ("other.offset_m", 0.0, "m", "any length")


def test_defaults_yield_to_the_file_and_the_file_to_settings(tmp_path: Path) -> None:
    file = tmp_path / "p.toml"
    file.write_text("[closure]\nthreshold = 0.5\npoints = 9\n[other]\nkind = 'tone'\n")
    made = load(Groups(), file, ["closure.threshold=0.6", "other.robust = false"])
    assert made == Groups(Closing(threshold=0.6, points=9), Closing(kind="tone", robust=False))
    assert load(Groups(), file, []).closure.threshold == 0.5
    assert load(Groups(), None, []) == Groups()


def test_the_last_setting_wins_and_words_need_no_quotes() -> None:
    made = load(Groups(), None, ["closure.kind=tone", "closure.kind=fhss", "other.kind='a=b'"])
    assert (made.closure.kind, made.other.kind) == ("fhss", "a=b")


def test_a_whole_number_will_do_for_a_float_but_stays_no_truth_value() -> None:
    assert repr(replace(Groups(), "closure.threshold", 1).closure.threshold) == "1.0"


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("closure.treshold=1", r"'closure.treshold'; did you mean closure.threshold\?"),
        ("closure.point=1", r"unknown parameter 'closure.point'; did you mean closure.points\?"),
        ("other.offset=1", r"unknown parameter 'other.offset'; did you mean other.offset_m\?"),
        ("zzz=1", "see `elfslam parameters`"),
        ("closure.points", "'closure.points': wanted group.name=value, for ex"),
        ("closure.threshold=high", "wanted float, got 'high'; for example closure.threshold=0.4"),
        ("closure.threshold=true", "wanted float, got True"),
        ("closure.threshold=", "wanted float, got ''"),
        ("closure.points=2.5", "wanted int, got 2.5"),
        ("closure.points=true", "wanted int, got True"),
        ("closure.robust=1", "wanted bool, got 1"),
        ("closure.kind=3", "wanted str, got 3"),
        ("closure.threshold=1.01", "closure.threshold: wanted a finite value from 0.0 to 1.0, got"),
        ("closure.threshold=-0.1", "from 0.0 to 1.0, got -0.1; choose one in that range"),
        ("closure.threshold=nan", "from 0.0 to 1.0, got nan"),
        ("closure.points=1", "wanted a finite value from 2, got 1"),
        ("closure.offset_m=10", "wanted a finite value to 9.0, got 10.0"),
        ("closure.offset_m=-inf", "wanted a finite value to 9.0, got -inf"),
        ("closure.free=nan", "wanted a finite value, got nan"),
    ],
)
def test_a_setting_that_cannot_be_says_what_is_wanted(setting: str, said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        load(Groups(), None, [setting])


@pytest.mark.parametrize("setting", ["closure.threshold=0", "closure.threshold=1"])
def test_both_ends_of_the_range_belong_to_it(setting: str) -> None:
    assert load(Groups(), None, [setting]).closure.threshold == float(setting[-1])


@pytest.mark.parametrize("content", [b"[closure\n", b"\xff\xfe", None])
def test_a_file_that_is_no_toml_is_refused_by_name(tmp_path: Path, content: bytes | None) -> None:
    file = tmp_path / "broken.toml"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(ParameterError, match=r"broken.toml: .* \(wanted TOML"):
        load(Groups(), file, [])


def test_a_value_outside_all_groups_is_unknown(tmp_path: Path) -> None:
    file = tmp_path / "p.toml"
    file.write_text("threshold = 0.5\n")
    with pytest.raises(ParameterError, match=r"unknown parameter 'threshold'; did you mean"):
        load(Groups(), file, [])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("closure.threshold", 0.41),
        ("other.threshold", 0.41),
        ("closure.points", 7),
        ("closure.robust", False),
        ("closure.kind", "tone"),
    ],
)
def test_the_digest_changes_exactly_when_a_value_does(name: str, value: Any) -> None:
    before = digest(Groups())
    changed = replace(Groups(), name, value)
    old = {row.name: row.value for row in rows(Groups())}[name]
    assert digest(changed) != before
    assert digest(replace(changed, name, old)) == before
    assert digest(Groups(Closing(), Closing())) == before
    assert len(before) == 16


def test_parameters_go_to_a_file_and_come_back(tmp_path: Path) -> None:
    made = Groups(Closing(threshold=0.25, robust=False), Closing(points=3))
    lines = [
        f"{group}.{name} = {str(value).lower() if isinstance(value, bool) else repr(value)}"
        for group, values in as_dict(made).items()
        for name, value in values.items()
    ]
    file = tmp_path / "all.toml"
    file.write_text("\n".join(lines))
    assert load(Groups(), file, []) == made
