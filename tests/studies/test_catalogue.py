"""Studies by name: what they are told and need, which are stale, and that a run cut off goes on."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pytest

from elfslam.base.errors import InputError, ParameterError
from elfslam.base.values import silent
from elfslam.stages.feature import SpectralEncoder
from elfslam.world.kinds import Kind
from studies import catalogue
from studies.cached import SCENARIOS
from studies.results import Record, commit_now, read_results, write_results
from studies.study import SampledError, Study, StudyContext, finished

MEDIAN = Record("ELF", "median error (m)", 0.25)


def measure(context: StudyContext, *, kind: Kind | None = None, much: int = 3) -> Iterable[Record]:
    scenario = "" if kind is None else SCENARIOS[kind.name]
    yield replace(MEDIAN, value=float(much), scenario=scenario)


GAIT = Study("How do people walk?", measure, minutes=5, fast={"much": 1}, long=True)
LANES = Study("Where?", measure, minutes=2, scenarios=("people", "surveyor"))


@pytest.fixture(autouse=True)
def planted(monkeypatch: pytest.MonkeyPatch) -> dict[str, Study]:
    """Two studies in place of all."""
    known = {"gait": GAIT, "lanes": LANES}
    monkeypatch.setattr(catalogue, "STUDIES", tuple(known))
    monkeypatch.setattr(catalogue, "study_named", known.__getitem__)
    monkeypatch.setattr(catalogue, "changed_since", lambda commit, module: [])
    monkeypatch.setattr(catalogue, "bound_cache", lambda: None)
    return known


def test_results_say_what_they_are_of(tmp_path: Path) -> None:
    catalogue.run_study("gait", catalogue.Choice(tmp_path), silent)
    (found,) = read_results(tmp_path / "gait.csv")
    assert (found.study, found.value, found.commit) == ("gait", 3.0, commit_now())
    (took,) = read_results(tmp_path / "remake.csv")
    assert (took.method, took.metric) == ("gait", "time (min)")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["gait.csv", "remake.csv"]


def test_a_scenario_takes_the_place_of_itself_alone(tmp_path: Path) -> None:
    for kind in ("people", "surveyor", "people"):
        catalogue.run_study("lanes", catalogue.Choice(tmp_path, kind=kind), silent)
    found = read_results(tmp_path / "lanes.csv")
    assert sorted(each.scenario for each in found) == ["pedestrian", "surveyor"]
    times = read_results(tmp_path / "remake.csv")
    assert sorted(each.condition for each in times) == ["people", "surveyor"]


@pytest.mark.parametrize(
    ("name", "choice", "words"),
    [
        ("gait", catalogue.Choice(kind="people"), "kind 'people': wanted none"),
        ("lanes", catalogue.Choice(kind="nobody"), "kind 'nobody': wanted people, surveyor"),
        ("lanes", catalogue.Choice(on="2"), "leave --on out"),
        ("gait", catalogue.Choice(encoders={"mine": SpectralEncoder()}), "leave --encoder out"),
    ],
)
def test_what_a_study_does_not_know_is_refused(
    tmp_path: Path, name: str, choice: catalogue.Choice, words: str
) -> None:
    with pytest.raises((InputError, ParameterError), match=words):
        catalogue.run_study(name, replace(choice, out=tmp_path / "new"), silent)
    assert not (tmp_path / "new" / f"{name}.csv").exists()


def test_what_is_needed_is_said_at_once(tmp_path: Path, planted: dict[str, Study]) -> None:
    planted["gait"] = replace(GAIT, needs=("torchless",), minutes=9)
    with pytest.raises(KeyError):
        catalogue.run_study("gait", catalogue.Choice(tmp_path), silent)
    planted["gait"] = replace(GAIT, data=("mall.mat",))
    for data, words in ((None, "ELFSLAM_DATA"), (tmp_path, "has no mall.mat")):
        with pytest.raises(InputError, match=words):
            list(catalogue.run_stale((), catalogue.Choice(tmp_path, data=data), silent))
    assert not (tmp_path / "lanes.csv").exists()


def test_a_sample_says_what_all_kinds_of_walk_would_take(planted: dict[str, Study]) -> None:
    def sampled(context: StudyContext, *, kind: Kind) -> Iterable[Record]:
        assert (context.sample, kind.name) == (1, "people")
        raise SampledError(first_s=7200.0, again_s=3600.0, repeats=5)

    planted["long"] = replace(LANES, measure=sampled, long=True)
    row = catalogue.sample_study("long", catalogue.Choice(), 1)
    assert row["repeats"] == 10
    assert (row["all, first (h)"], row["all, again (h)"]) == (10.0, 5.0)
    with pytest.raises(InputError, match="lanes: is short"):
        catalogue.sample_study("lanes", catalogue.Choice(), 1)


def test_all_runs_what_is_stale_the_cheapest_first(tmp_path: Path) -> None:
    every = catalogue.run_stale((), catalogue.Choice(tmp_path), silent)
    done = [(each.name, each.kind) for each in every]
    assert done == [("lanes", "people"), ("lanes", "surveyor"), ("gait", None)]
    assert list(catalogue.run_stale((), catalogue.Choice(tmp_path), silent)) == []
    assert list(catalogue.run_stale(("gait",), catalogue.Choice(tmp_path), silent)) == []


def test_progress_is_of_the_whole(tmp_path: Path, planted: dict[str, Study]) -> None:
    heard: list[float | None] = []

    def slow(context: StudyContext) -> Iterable[Record]:
        context.announce("half of it", 0.5)
        return [MEDIAN]

    planted["gait"] = replace(GAIT, measure=slow, minutes=6)
    list(
        catalogue.run_stale((), catalogue.Choice(tmp_path), lambda what, share: heard.append(share))
    )
    assert heard == [pytest.approx((2 + 3) / 8)]


@pytest.mark.parametrize("what", ["encoder", "code", "commits", "missing"])
def test_why_results_are_stale(tmp_path: Path, what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    catalogue.run_study("gait", catalogue.Choice(tmp_path), silent)
    (found,) = read_results(tmp_path / "gait.csv")
    file, wanted = tmp_path / "gait.csv", "never run"
    if what == "encoder":
        write_results(file, [replace(found, encoder="older")])
        wanted = "encoder older, now"
    elif what == "code":
        monkeypatch.setattr(catalogue, "changed_since", lambda commit, module: ["a.py:b"])
        wanted = "1 changed since"
    elif what == "commits":
        write_results(file, [found, replace(found, commit="older")])
        wanted = "of several commits"
    else:
        file.unlink()
    (stale,) = catalogue.stale_studies(("gait",), catalogue.Choice(tmp_path))
    assert stale.why.startswith(wanted)


def test_every_study_says_what_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    for name in catalogue.STUDIES:
        study = catalogue.study_named(name)
        assert study.question.endswith("?"), name
        assert study.minutes > 0, name
        assert study.fast or study.minutes < 2, name
        assert set(study.scenarios) <= set(SCENARIOS), name


def test_a_run_that_was_cut_off_goes_on(tmp_path: Path, planted: dict[str, Study]) -> None:
    asked: list[int] = []

    def repeat(task: int) -> list[Record]:
        asked.append(task)
        if asked == [1, 2]:
            raise KeyboardInterrupt
        return [replace(MEDIAN, value=float(task))]

    def repeats(context: StudyContext) -> Iterable[Record]:
        return [each for found in finished(repeat, [1, 2, 3], context) for each in found]

    planted["gait"] = replace(GAIT, measure=repeats, fast={})
    with pytest.raises(KeyboardInterrupt):
        list(catalogue.run_stale(("gait",), catalogue.Choice(tmp_path), silent))
    assert [path.name for path in tmp_path.iterdir()] == ["gait.partial"]
    list(catalogue.run_stale(("gait",), catalogue.Choice(tmp_path), silent))
    assert asked == [1, 2, 2, 3]
    assert [each.value for each in read_results(tmp_path / "gait.csv")] == [1.0, 2.0, 3.0]
    assert not (tmp_path / "gait.partial").exists()
