"""How long things have lain untouched, counted while the server runs: no clock can be set.

A clock that is put forward by a year must not make everything a year old.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from elfslam.data.atomic_files import replaced_file

AGES = "ages.json"


@dataclass(frozen=True)
class Age:
    """For how long a thing has been as it is, which its size tells."""

    size_bytes: int
    untouched_s: float = 0.0


Ages = Mapping[str, Age]


def grown(before: Ages, sizes_bytes: Mapping[str, int], passed_s: float) -> dict[str, Age]:
    """The ages of things after some time: what is new or another size begins anew."""
    known = {name: age for name, age in before.items() if age.size_bytes == sizes_bytes.get(name)}
    fresh = {name: Age(size_bytes) for name, size_bytes in sizes_bytes.items()}
    older = {name: Age(age.size_bytes, age.untouched_s + passed_s) for name, age in known.items()}
    return fresh | older


def older_than(ages: Ages, days: float) -> list[str]:
    """What has lain untouched for longer."""
    return [name for name, age in ages.items() if age.untouched_s > days * 86_400]


def read_ages(folder: Path) -> dict[str, Age]:
    """The ages that a folder keeps; none where they are missing or damaged: all begin anew."""
    try:
        told = json.loads((folder / AGES).read_text(encoding="utf-8"))
        return {str(name): Age(int(size), float(age_s)) for name, (size, age_s) in told.items()}
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):
        return {}


def write_ages(folder: Path, ages: Ages) -> None:
    """Keep ages in a folder. Raises StoreError."""
    with replaced_file(folder / AGES) as partial:
        told = {name: [age.size_bytes, age.untouched_s] for name, age in ages.items()}
        partial.write_text(json.dumps(told), encoding="utf-8")
