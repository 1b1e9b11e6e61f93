"""The README's table: how far off maps and fixes are, in three places, beside the paper's.

Rendered between `<!-- summary -->` and `<!-- /summary -->` of what mapping and localization
measured; what was not measured is a dash.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from studies.mapping import CALIBRATED
from studies.plain_features import ELF, LOG, PLAIN, ROOT
from studies.render import DASH, figure_text
from studies.results import RESULTS, Result, read_results
from studies.study import MEDIAN_ALIGNED

PLACES = ("living_room", "office", "mall")
SCENARIOS = {"surveyor": "surveyor", "pedestrian": "pedestrians"}
HAND_MADE = (PLAIN, ROOT, LOG)
METHODS = ("hand made", "ours", "paper")
OURS = METHODS[1]
RECKONED = "dead reckoning"
"""Of the walks that are mapped: two rows of one figure for each place."""
MEDIAN, ANSWERED = "median error (m)", "answered"
ALWAYS = ", always answered"
ONE_SHOT, TRAJECTORY, TRACK = "one-shot", "trajectory", "track"


@dataclass(frozen=True)
class Task:
    """What a row is about, and where its figures stand.

    `ours` is a method as results name it, `condition` what it was measured under; `paper` the
    condition under which the paper has its figure. Hand-made features are named as ours is.
    """

    label: str
    study: str
    metric: str
    condition: str
    paper: str
    suffix: str = ""


TASKS = (
    Task("mapped", "mapping", MEDIAN_ALIGNED, CALIBRATED, CALIBRATED),
    Task("from 0.6 s", "localization", MEDIAN, ONE_SHOT, ONE_SHOT, ALWAYS),
    Task("walking", "localization", MEDIAN, TRACK, TRAJECTORY),
)
"""From 0.6 s every feature answers always: only so are features compared with each other."""


def summary_table(folder: Path = RESULTS) -> str:
    """The table as HTML, with a line that says what it was made of.

    Raises InputError for a result file of another form.
    """
    results = [
        each
        for study in dict.fromkeys(task.study for task in TASKS)
        if (folder / f"{study}.csv").exists()
        for each in read_results(folder / f"{study}.csv")
    ]
    used: list[Result] = []
    rows = [
        _row(f"{task.label}, {walked}", [_cell(name, each, used)
             for place in PLACES
             for name, each in _figures(results, task, scenario, place)])
        for task in TASKS
        for scenario, walked in SCENARIOS.items()
    ]  # fmt: skip
    reckoned = [_reckoned(results, scenario, used) for scenario in SCENARIOS]
    return "\n".join(["<table>", *_head(), *reckoned, *rows, "</table>", "", _below(results, used)])


def _reckoned(results: Sequence[Result], scenario: str, used: list[Result]) -> str:
    wanted = ("mapping", scenario, RECKONED, CALIBRATED, MEDIAN_ALIGNED)
    found = {
        each.world: each for each in results
        if (each.study, each.scenario, each.method, each.condition, each.metric) == wanted
    }  # fmt: skip
    used += found.values()
    cells = (
        f'<td align="center" colspan="{len(METHODS)}">'
        f"{_small(figure_text(found[place].value) if place in found else DASH)}</td>"
        for place in PLACES
    )
    return _row(f"{RECKONED}, {SCENARIOS[scenario]}", cells)


def _figures(
    results: Sequence[Result], task: Task, scenario: str, place: str
) -> Iterator[tuple[str, Result | None]]:
    """By method what a cell shows, in the order of the columns."""
    here = [each for each in results if each.study == task.study and each.scenario == scenario
            and each.world == place and each.metric == task.metric]  # fmt: skip

    def found(method: str, condition: str = task.condition) -> Result | None:
        some = (each for each in here if each.method == method and each.condition == condition)
        return next(some, None)

    plain = [each for each in (found(name + task.suffix) for name in HAND_MADE) if each]
    paper = found(ELF, task.paper)
    yield METHODS[0], min(plain, key=lambda each: each.value, default=None)
    yield OURS, found(ELF + task.suffix)
    yield METHODS[2], paper if paper and paper.paper is not None else None


def _cell(method: str, result: Result | None, used: list[Result]) -> str:
    if result is None:
        return _aligned(DASH)
    used.append(result)
    if method == METHODS[2] and result.paper is not None:
        return _aligned(figure_text(result.paper))
    text = figure_text(result.value)
    return _aligned(f"<b>{text}</b>" if method == OURS else text)


def _head() -> list[str]:
    places = "".join(
        f'<th colspan="{len(METHODS)}">{place.replace("_", " ")}</th>' for place in PLACES
    )
    methods = "".join(f"<th>{_small(method.replace(' ', '<br>'))}</th>" for method in METHODS)
    return [
        f'<tr><th rowspan="2">{_small("median<br>error (m)")}</th>{places}</tr>',
        f"<tr>{methods * len(PLACES)}</tr>",
    ]


def _row(label: str, cells: Iterable[str]) -> str:
    return f"<tr><td nowrap>{_small(label)}</td>{''.join(cells)}</tr>"


def _aligned(text: str) -> str:
    return f'<td align="right">{_small(text)}</td>'


def _small(text: str) -> str:
    """So that twelve columns fit beside each other."""
    return f"<small>{text}</small>"


def _below(results: Sequence[Result], used: Sequence[Result]) -> str:
    """Shares of footsteps with a fix, as an error alone says little, and who measured when."""
    lines = [_answered(results, scenario) for scenario in SCENARIOS]
    lines += sorted({
        f"`python -m studies {each.study}`, {each.scenario}: commit {each.commit}, {each.date}"
        for each in used
    })  # fmt: skip
    return "<sub>" + "<br>\n".join(filter(None, lines)) + "</sub>"


def _answered(results: Sequence[Result], scenario: str) -> str:
    wanted = ("localization", scenario, ELF, TRACK, ANSWERED)
    shares = {
        each.world: f"{100 * each.value:.0f} %"
        for each in results
        if (each.study, each.scenario, each.method, each.condition, each.metric) == wanted
    }
    if not shares:
        return ""
    found = ", ".join(shares.get(place, DASH) for place in PLACES)
    return f"Footsteps with a fix while walking, {SCENARIOS[scenario]}: {found}."
