"""Parameters: one frozen dataclass per stage; every field has a unit and a meaning.

Order of precedence: defaults < TOML file < single settings ("closure.threshold=0.5").
"""

import dataclasses
import difflib
import hashlib
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from elfslam.base.errors import InputError, ParameterError
from elfslam.base.text_files import parse_toml, read_toml

Group = TypeVar("Group")


def parameter(default: Any, unit: str, meaning: str, low: Any = None, high: Any = None) -> Any:
    """A dataclass field that documents itself; `low` and `high` bound it, both included."""
    metadata = {"unit": unit, "meaning": meaning, "low": low, "high": high}
    return dataclasses.field(default=default, metadata=metadata)


@dataclass(frozen=True)
class ParameterRow:
    """One parameter as `elfslam parameters` prints it."""

    name: str
    value: Any
    unit: str
    meaning: str


def rows(groups: Any) -> Iterator[ParameterRow]:
    """Every parameter of a dataclass of groups, named group.field."""
    for group_field in dataclasses.fields(groups):
        group = getattr(groups, group_field.name)
        for item in dataclasses.fields(group):
            value = getattr(group, item.name)
            name = f"{group_field.name}.{item.name}"
            yield ParameterRow(name, value, item.metadata["unit"], item.metadata["meaning"])


def as_dict(groups: Any) -> dict[str, dict[str, Any]]:
    """Plain nested dictionary, ready for JSON or TOML."""
    return dataclasses.asdict(groups)


def digest(groups: Any) -> str:
    """Short hash of all parameter values; equal parameters give equal digests."""
    text = json.dumps(as_dict(groups), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def load(defaults: Group, file: Path | None, settings: Iterable[str]) -> Group:
    """`defaults` overridden by a TOML file and then by "group.name=value" settings."""
    groups = defaults
    if file is not None:
        for name, value in _flatten(_read(file)):
            groups = replace(groups, name, value)
    for setting in settings:
        name, separator, text = setting.partition("=")
        if not separator:
            raise ParameterError(
                f"setting {setting!r:.60}: wanted group.name=value, "
                "for example closure.threshold=0.5"
            )
        groups = replace(groups, name.strip(), _literal(text.strip()))
    return groups


def replace(groups: Group, name: str, value: Any) -> Group:
    """`groups` with the one parameter called group.name changed."""
    known = {row.name: row.value for row in rows(groups)}
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1, cutoff=0.4)
        hint = f"did you mean {near[0]}?" if near else "see `elfslam parameters`"
        raise ParameterError(f"unknown parameter {name!r:.60}; {hint}")
    group_name, field_name = name.split(".")
    group = getattr(groups, group_name)
    item = next(item for item in dataclasses.fields(group) if item.name == field_name)
    checked = _checked(name, value, known[name], item.metadata)
    changed = dataclasses.replace(group, **{field_name: checked})
    return dataclasses.replace(groups, **{group_name: changed})  # type: ignore[type-var]


def _checked(name: str, value: Any, old: Any, metadata: Mapping[str, Any]) -> Any:
    wanted = type(old)
    if wanted is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not wanted:
        raise ParameterError(
            f"{name}: wanted {wanted.__name__}, got {value!r:.60}; for example {name}={old}"
        )
    low, high = metadata["low"], metadata["high"]
    inside = (low is None or value >= low) and (high is None or value <= high)
    if not inside or (wanted is float and not math.isfinite(value)):
        raise ParameterError(
            f"{name}: wanted {_range(low, high)}, got {value!r}; choose one in that range"
        )
    return value


def _range(low: Any, high: Any) -> str:
    ends = [f"from {low}"] * (low is not None) + [f"to {high}"] * (high is not None)
    return " ".join(["a finite value", *ends])


def _literal(text: str) -> Any:
    try:
        return parse_toml(f"value = {text}", "setting")["value"]
    except InputError:
        return text


def _read(file: Path) -> dict[str, Any]:
    try:
        return read_toml(file)
    except InputError as cause:
        raise ParameterError(f"{cause} (wanted TOML, see `elfslam parameters`)") from cause


def _flatten(nested: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for group, values in nested.items():
        if isinstance(values, dict):
            yield from ((f"{group}.{name}", value) for name, value in values.items())
        else:
            yield group, values
