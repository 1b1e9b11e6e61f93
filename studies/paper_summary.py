"""Which parts of the paper have a result of ours, and on which side of the paper's it lies.

Every part of `docs/paper.md` that has a figure or table is here, with the study that makes ours and
the rows that are to be compared. Counted is what stands in `results/` when this runs.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from studies.results import RESULTS, Record, Result, read_results
from studies.study import Study, StudyContext

PARTS_OF, WITH_OURS, WITHOUT = "parts of the paper", "of them with ours", "of them without ours"
COMPARED, CLOSER, FARTHER, OTHER = (
    "numbers that the paper gives and we have", "ours smaller error", "ours larger error",
    "not errors",
)  # fmt: skip
ALL = "whole paper"
MAPPING_ERRORS = "median error, aligned (m)|mean error, aligned (m)|third quartile, aligned (m)"


@dataclass(frozen=True)
class Part:
    """A figure or table: its heading in the page, the study, and which of its rows are ours.

    What is `apart` is no claim of ours (a baseline, the paper's strategy) and not in the whole.
    """

    name: str
    study: str = ""
    where: Mapping[str, str] = field(default_factory=dict)
    apart: bool = False


TABLE_2 = {"scenario": "surveyor", "condition": "calibrated", "metric": MAPPING_ERRORS}
TABLE_3 = {"scenario": "surveyor", "condition": "one-shot|trajectory"}
SPOTS = {"world": "hall", "metric": "mean error (m)"}


def _sensitivity(*conditions: str) -> dict[str, str]:
    return {"scenario": "pedestrian", "condition": "|".join(conditions), "method": "ELF,*"}


PARTS = (
    Part("Figure 1: excitation", "paper-figures", {"method": "chirp|received"}),
    Part("Figure 3: spectrograms at three spots", "paper-figures", {"method": "*spot A*|2 m*"}),
    Part("Figure 4: t-SNE by chirp and tone", "distinctness", {"metric": "t-SNE*"}),
    Part("Figure 5a: spatial resolution", "spots", {"condition": "*m apart"}),
    Part("Figure 5b: scalability", "spots", {"condition": "*spots"}),
    Part("Figure 6a: altitude", "stability", {"condition": "*cm high"}),
    Part("Figure 6b: orientation", "stability", {"condition": "*degrees of yaw"}),
    Part("Figure 6c: data age", "stability", {"condition": "*days"}),
    Part("Figure 8: ESS traces", "trace", {"metric": "ESS with*"}),
    Part("Figure 10: spectrograms near and far", "paper-figures", {"method": "*from A"}),
    Part("Figure 11: similarity visualised", "trace", {"metric": "ESS"}),
    Part("Figure 12: ESS matrix", "paper-figures", {"method": "candidates"}),
    Part("Figure 13: with and without curation", "paper-figures", {"method": "without curation"}),
    Part("Figure 14: curation step by step", "closures"),
    Part("Figure 15: reconstructed trajectories", "paper-figures", {"metric": "x (m)"}),
    Part("Table 2: mapping errors", "mapping", {**TABLE_2, "method": "ELF"}),
    Part("Table 2: its baselines", "mapping",
         {**TABLE_2, "method": "ELF without*|wifi*|magnetic*"}, apart=True),
    Part("Figure 16: fine-tuning loss", "amounts", {"metric": "NT-Xent loss"}),
    Part("Figure 17: amount of pre-training data", "amounts", {"condition": "*echoes"}),
    Part("Figure 18: amount of fine-tuning data", "amounts", {"condition": "*minutes"}),
    Part("Table 3: localization errors", "localization", {**TABLE_3, "method": "ELF"}),
    Part("Table 3: its baselines", "localization", {**TABLE_3, "method": "wifi*|magnetic*"},
         apart=True),
    Part("Figure 19: ELF sequence length", "sensitivity", _sensitivity("* s")),
    Part("Figure 20: moving people", "sensitivity", _sensitivity("* people")),
    Part("Figure 21: ageing", "sensitivity", _sensitivity("* days")),
    Part("Figure 22: audible noise", "sensitivity", _sensitivity("noise:*")),
    Part("Figure 23: moved furniture", "sensitivity", _sensitivity("* moved")),
    Part("Figure 24: loudspeaker volume", "sensitivity", _sensitivity("* volume")),
    Part("Figure 25: other phones", "sensitivity", _sensitivity("phone:*")),
    Part("Figure 26: superimposition of two walks", "superimposition",
         {"world": "living_room", "method": "same direction|superimposed"}),
    Part("Figure 27: superimposition of 4,000 spots", "superimposition",
         {**SPOTS, "method": "superimposed"}),
    Part("Figure 28: simulated space"),
    Part("Figure 29: one spot in four directions", "superimposition",
         {"metric": "similarity of four directions"}),
    Part("Figure 30: overhead", "localization-cost"),
    Part("The paper's own strategy in our worlds", "paper", apart=True),
)  # fmt: skip
"""In the paper's order; without a study where we have none."""


def measure_paper_summary(
    context: StudyContext, *, results: Path = RESULTS, parts: Sequence[Part] = PARTS
) -> list[Record]:
    """For each part and for the whole: what there is, and how many errors are smaller or larger."""
    found = {part.name: compared(part, results) for part in parts}
    counts = {name: numbers for name, numbers in found.items() if numbers}
    whole = [part.name for part in parts if not part.apart]
    have = [counts[name] for name in whole if name in counts]
    total = {
        PARTS_OF: len(whole),
        WITH_OURS: len(have),
        WITHOUT: len(whole) - len(have),
        **{key: sum(each[key] for each in have) for key in (COMPARED, CLOSER, FARTHER, OTHER)},
    }
    return [
        Record(name, metric, float(value))
        for name, numbers in {ALL: total, **counts}.items()
        for metric, value in numbers.items()
        if name == ALL or value or numbers[COMPARED] > numbers[OTHER]
    ]


def compared(part: Part, results: Path = RESULTS) -> dict[str, int]:
    """How many of the paper's numbers ours stand beside, and how; nothing where we have no rows."""
    file = results / f"{part.study}.csv"
    if not part.study or not file.exists():
        return {}
    rows = chosen(read_results(file), part.where)
    if not rows:
        return {}
    pairs = list(_pairs(rows))
    errors = [(ours, theirs) for metric, ours, theirs in pairs if "error" in metric]
    closer = sum(ours < theirs for ours, theirs in errors)
    return {
        COMPARED: len(pairs), CLOSER: closer, FARTHER: len(errors) - closer,
        OTHER: len(pairs) - len(errors),
    }  # fmt: skip


def chosen(rows: Sequence[Result], where: Mapping[str, str]) -> list[Result]:
    """The rows whose columns are as wanted: several by `|`, `*` before or behind for anything."""
    from fnmatch import fnmatchcase

    return [
        row
        for row in rows
        if all(
            any(fnmatchcase(str(getattr(row, name)), each) for each in wanted.split("|"))
            for name, wanted in where.items()
        )
    ]


def _pairs(rows: Sequence[Result]) -> Iterator[tuple[str, float, float]]:
    for row in rows:
        if row.paper is not None:
            yield row.metric, row.value, row.paper


STUDY = Study(
    "Which parts of the paper have a result of ours, and are its errors smaller or larger?",
    measure_paper_summary, minutes=0.1, counts=True,
)  # fmt: skip
