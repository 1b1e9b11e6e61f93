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
    assert (listed[8].name, listed[8].value, listed[8].unit, listed[8].meaning) == (
        "other.offset_m",
        0.0,
        "m",
        "any length",
    )


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
    threshold = replace(Groups(), "closure.threshold", 1).closure.threshold
    assert isinstance(threshold, float)
    assert threshold == 1.0


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("closure.treshold", "closure.threshold"),
        ("closure.point", "closure.points"),
        ("other.offset", "other.offset_m"),
    ],
)
def test_an_unknown_name_is_answered_with_the_near_one(name: str, near: str) -> None:
    with pytest.raises(ParameterError, match=rf"unknown parameter '{name}'; did you mean {near}\?"):
        load(Groups(), None, [f"{name}=1"])


def test_a_name_near_to_nothing_points_to_the_list() -> None:
    with pytest.raises(ParameterError, match="see `elfslam parameters`"):
        load(Groups(), None, ["zzz=1"])


@pytest.mark.parametrize(
    ("setting", "wanted"),
    [
        ("closure.threshold=high", "wanted float, got 'high'; for example closure.threshold=0.4"),
        ("closure.threshold=true", "wanted float, got True"),
        ("closure.threshold=", "wanted float, got ''"),
        ("closure.points=2.5", "wanted int, got 2.5"),
        ("closure.points=true", "wanted int, got True"),
        ("closure.robust=1", "wanted bool, got 1"),
        ("closure.kind=3", "wanted str, got 3"),
    ],
)
def test_a_wrong_type_says_what_is_wanted(setting: str, wanted: str) -> None:
    with pytest.raises(ParameterError, match=wanted):
        load(Groups(), None, [setting])


@pytest.mark.parametrize(
    ("setting", "wanted"),
    [
        ("closure.threshold=1.01", "closure.threshold: wanted a finite value from 0.0 to 1.0, got"),
        ("closure.threshold=-0.1", "from 0.0 to 1.0, got -0.1; choose one in that range"),
        ("closure.threshold=nan", "from 0.0 to 1.0, got nan"),
        ("closure.points=1", "wanted a finite value from 2, got 1"),
        ("closure.offset_m=10", "wanted a finite value to 9.0, got 10.0"),
        ("closure.offset_m=-inf", "wanted a finite value to 9.0, got -inf"),
        ("closure.free=nan", "wanted a finite value, got nan"),
    ],
)
def test_a_value_out_of_range_says_the_range(setting: str, wanted: str) -> None:
    with pytest.raises(ParameterError, match=wanted):
        load(Groups(), None, [setting])


@pytest.mark.parametrize("setting", ["closure.threshold=0", "closure.threshold=1"])
def test_both_ends_of_the_range_belong_to_it(setting: str) -> None:
    assert load(Groups(), None, [setting]).closure.threshold == float(setting[-1])


def test_a_setting_without_an_equals_sign_is_refused_with_an_example() -> None:
    with pytest.raises(ParameterError, match=r"'closure.points': wanted group.name=value, for ex"):
        load(Groups(), None, ["closure.points"])


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
