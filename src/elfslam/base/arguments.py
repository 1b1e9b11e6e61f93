"""Run-time type checking: a public function refuses what its annotations do not allow."""

import inspect
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache, wraps
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Annotated, Any, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from elfslam.base.errors import ParameterError

P = ParamSpec("P")
Result = TypeVar("Result")
SHOWN_CHARACTERS = 60


@dataclass(frozen=True)
class Such:
    """What a type does not say, in Annotated: which of its values are wanted, and in words."""

    holds: Callable[[Any], bool]
    words: str


PLAIN: dict[Any, Such] = {
    Any: Such(lambda value: True, "anything"),
    NoneType: Such(lambda value: value is None, "None"),
    bool: Such(lambda value: isinstance(value, bool | np.bool_), "True or False"),
    int: Such(lambda value: _is(Integral, value), "integer"),
    float: Such(lambda value: _is(Real, value) and -math.inf < value < math.inf, "finite number"),
    str: Such(lambda value: isinstance(value, str), "text"),
    Callable: Such(callable, "function"),
    Mapping: Such(lambda value: isinstance(value, Mapping), "dictionary"),
}
Seed = Annotated[int, Such(lambda seed: 0 <= seed < 2**63, "integer from 0 to 2**63 - 1")]


def checked(function: Callable[P, Result]) -> Callable[P, Result]:
    """`function`, which raises ParameterError for an argument that its annotation does not allow.

    The refusal says which argument, what was wanted and what came. A float is finite, a tuple may
    come as a list and a StrEnum as its text, and a protocol is whatever has its members.
    """
    signature, name = inspect.signature(function), function.__name__

    @cache
    def wanted() -> dict[str, Any]:
        return get_type_hints(function, include_extras=True)

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> Result:
        try:
            given = signature.bind(*args, **kwargs).arguments
        except TypeError as cause:
            raise ParameterError(f"{name}: {cause}; see help({name})") from cause
        for argument, value in given.items():
            if not fits(value, wanted()[argument]):
                raise ParameterError(
                    f"{name}: {argument}: wanted {in_words(wanted()[argument])}, "
                    f"got {shown(value)}; see help({name})"
                )
        return function(*args, **kwargs)

    return call


def _is(kind: type, value: Any) -> bool:
    return isinstance(value, kind) and not isinstance(value, bool)


def fits(value: Any, wanted: Any) -> bool:
    """Whether a value is what an annotation allows."""
    origin, parts = get_origin(wanted), get_args(wanted)
    if origin is Annotated:
        return fits(value, parts[0]) and all(each.holds(value) for each in parts[1:])
    if origin in (Union, UnionType):
        return any(fits(value, part) for part in parts)
    if origin is tuple:
        return isinstance(value, tuple | list) and _fit_each(value, parts)
    if origin in (Collection, Sequence, Mapping):
        is_many = isinstance(value, origin) and not isinstance(value, str | bytes)
        return is_many and _fit_each(value, parts[:1] * len(value))
    return _plain(origin or wanted).holds(value)


def _plain(kind: Any) -> Such:
    """What counts as a value of a type without parts."""
    if kind in PLAIN:
        return PLAIN[kind]
    if issubclass(kind, StrEnum):
        return Such(lambda value: isinstance(value, str) and value in set(kind), " or ".join(kind))
    return Such(
        lambda value: isinstance(value, kind) and not isinstance(value, type), kind.__name__
    )


def _fit_each(values: Iterable[Any], wanted: Sequence[Any]) -> bool:
    each = list(values)
    return len(each) == len(wanted) and all(map(fits, each, wanted))


def in_words(wanted: Any) -> str:
    """What an annotation allows, for a person."""
    origin, parts = get_origin(wanted), get_args(wanted)
    if origin is Annotated:
        return str(parts[-1].words)
    if origin in (Union, UnionType):
        *others, last = [in_words(part) for part in parts]
        return f"{', '.join(others)} or {last}"
    if origin is tuple:
        return f"({', '.join(map(in_words, parts))})"
    if origin in (Collection, Sequence):
        return f"list of {in_words(parts[0])}"
    return _plain(origin or wanted).words


def shown(value: object) -> str:
    """The type of a value and its beginning, in one short line."""
    text = " ".join(repr(value).split())[:SHOWN_CHARACTERS]
    kind = type(value).__name__
    return text if value is None or text.startswith(kind) else f"{kind} {text}"
