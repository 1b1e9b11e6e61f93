"""Which parts of the paper have a result of ours, and on which side of the paper's it lies.

Every part of `docs/paper.md` that has a figure or table is here, with the study that makes ours and
the rows that are to be compared. Counted is what stands in `results/` when this runs.
"""

from __future__ import annotations

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
PAPERS_OWN = "paper's own"


@dataclass(frozen=True)
class Part:
    """A figure or table: its heading in the page, the study, and which of its rows are ours."""

    name: str
    study: str = ""
    where: Mapping[str, str] = field(default_factory=dict)


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
    Part("Table 2: mapping errors", "mapping",
         {"scenario": "surveyor", "condition": "calibrated", "metric": MAPPING_ERRORS}),
    Part("Figure 16: fine-tuning loss", "amounts", {"metric": "NT-Xent loss"}),
    Part("Figure 17: amount of pre-training data", "amounts", {"condition": "*echoes"}),
    Part("Figure 18: amount of fine-tuning data", "amounts", {"condition": "*minutes"}),
    Part("Table 3: localization errors", "localization", {"scenario": "surveyor"}),
    Part("Figure 19: ELF sequence length", "sensitivity", _sensitivity("* s")),
    Part("Figure 20: moving people", "sensitivity", _sensitivity("* people")),
    Part("Figure 21: ageing", "sensitivity", _sensitivity("* days")),
    Part("Figure 22: audible noise", "sensitivity", _sensitivity("noise:*")),
    Part("Figure 23: moved furniture", "sensitivity", _sensitivity("* moved")),
    Part("Figure 24: loudspeaker volume", "sensitivity", _sensitivity("* volume")),
    Part("Figure 25: other phones", "sensitivity", _sensitivity("phone:*")),
    Part("Figure 26: superimposition of two walks", "superimposition", {"world": "living_room"}),
    Part("Figure 27: superimposition of 4,000 spots", "superimposition",
         {"world": "hall", "metric": "mean error (m)"}),
    Part("Figure 28: simulated space"),
    Part("Figure 29: one spot in four directions", "superimposition",
         {"metric": "similarity of four directions"}),
    Part("Figure 30: overhead", "localization-cost"),
    Part(f"The {PAPERS_OWN} strategy in our worlds", "paper"),
)  # fmt: skip
"""In the paper's order; without a study where we have none. The last stands for all of section 6
with nothing added, so its numbers are counted by themselves."""


def measure_paper_summary(
    context: StudyContext, *, results: Path = RESULTS, parts: Sequence[Part] = PARTS
) -> list[Record]:
    """For each part and for the whole: what there is, and how many errors are smaller or larger."""
    found = {part.name: compared(part, results) for part in parts}
    counts = {name: numbers for name, numbers in found.items() if numbers}
    others = [numbers for name, numbers in counts.items() if PAPERS_OWN not in name]
    whole = {
        PARTS_OF: len(parts),
        WITH_OURS: len(counts),
        WITHOUT: len(parts) - len(counts),
        **{key: sum(each[key] for each in others) for key in (COMPARED, CLOSER, FARTHER, OTHER)},
    }
    return [
        Record(name, metric, float(value))
        for name, numbers in {ALL: whole, **counts}.items()
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
    measure_paper_summary, minutes=0.1,
)  # fmt: skip
