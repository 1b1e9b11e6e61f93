"""What a study is: what it measures, what it needs, what it costs; and what it is given."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from elfslam.app.workers import Workers
from elfslam.base.errors import InputError
from elfslam.base.values import Announce, silent
from studies.results import Record

SCENARIOS: Mapping[str, str] = {
    "people": "pedestrian", "surveyor": "surveyor", "quiet": "controlled",
}  # fmt: skip
"""By kind of simulated walk what results call it: who walks how, and in what circumstances."""
EXTRAS: Mapping[str, str] = {
    "torch": "learn", "sklearn": "studies", "pyroomacoustics": "acoustics", "pystoi": "speech",
    "ray": "scale",
}  # fmt: skip
"""By module that a study may need what brings it."""


@dataclass(frozen=True)
class StudyContext:
    """The folder of real recordings, who hears of progress, and who works.

    A long study keeps what is finished in the file `kept`, and gives its repeats to `workers`;
    where `sample` is a number, it times so many and ends.
    """

    data: Path | None = None
    announce: Announce = silent
    kept: Path | None = None
    workers: Workers | None = None
    sample: int | None = None


Measure = Callable[..., Iterable[Record]]
"""Makes records of a context, and of what else a study is told by name."""


@dataclass(frozen=True)
class Study:
    """A question with a table or figure: who measures it, and what that takes.

    `scenarios` are kinds of walk, each a run of its own; `fast` are the arguments of a variant that
    takes seconds. `needs` are modules to be installed; `data` the files of other people's that it
    reads, below the folder of recordings. A study that is `long` goes on from what is kept, and
    shares its repeats out.
    """

    question: str
    measure: Measure
    minutes: float
    """On two cores, with simulated walks in the cache."""
    fast: Mapping[str, Any] = field(default_factory=dict)
    scenarios: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    data: tuple[str, ...] = ()
    long: bool = False
    encoders: bool = False
    """Whether it compares encoders that it is given."""
    recordings: bool = False
    """Whether it can be made of a recording of one's own."""
    counts: bool = False
    """Whether it counts what others measured: it runs after them, whenever one of them ran."""

    def check(self, name: str, data: Path | None) -> None:
        """Raise InputError where something is missing that the study would ask for later."""
        for module in self.needs:
            if find_spec(module) is None:
                extra = EXTRAS[module]
                raise InputError(f"study {name}: needs {module}; `make studies` installs [{extra}]")
        if not self.data:
            return
        if data is None:
            raise InputError(
                f"study {name}: reads recordings of other people; name their folder "
                "with --data or in ELFSLAM_DATA"
            )
        missing = [each for each in self.data if not (data / each).exists()]
        if missing:
            raise InputError(f"study {name}: {data} has no {', '.join(missing)}; it needs them")
