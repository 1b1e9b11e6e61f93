"""Frozen values: dataclasses whose arrays have declared shapes, checked and made read-only."""

import re
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from elfslam.base.errors import InputError

F64 = npt.NDArray[np.float64]
F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]
C128 = npt.NDArray[np.complex128]
Dimension = int | str
LARGEST = np.float64(1e15)
"""Beyond anything that is measured or counted; it can still be squared."""
LONGEST_TEXT = 60
ROUNDING = 1e-6
"""How far, relative to its largest variance, rounding may take a covariance from being one."""


@dataclass(frozen=True)
class ArraySpec:
    """What an array field must look like; dimensions are sizes, or names such as "n" and "n-1"."""

    shape: tuple[Dimension, ...]
    dtype: type
    finite: bool
    increasing: bool
    unit_rows: bool
    covariance: bool
    largest: float
    least: int


def array(
    *shape: Dimension,
    dtype: type = np.float64,
    finite: bool = True,
    increasing: bool = False,
    unit_rows: bool = False,
    covariance: bool = False,
    largest: float = LARGEST,
    optional: bool = False,
    least: int = 0,
) -> Any:
    """A dataclass field that holds an array of the declared shape, of `least` rows or more.

    A `covariance` holds symmetric matrices without a negative variance in any direction.
    """
    spec = ArraySpec(shape, dtype, finite, increasing, unit_rows, covariance, largest, least)
    metadata = {"array": spec}
    return field(default=None, metadata=metadata) if optional else field(metadata=metadata)


def summary(value: Any) -> str:
    """The name of a dataclass, and of each field its shape or its short text."""
    parts = (
        f"{item.name}: {_told(getattr(value, item.name))}"
        for item in fields(value)
        if getattr(value, item.name) is not None
    )
    return f"{type(value).__name__}({', '.join(parts)})"


def _told(value: object) -> str:
    if isinstance(value, np.ndarray):
        return " x ".join(map(str, value.shape)) if value.ndim else str(value)
    text = repr(value)
    return text if len(text) <= LONGEST_TEXT else f"{type(value).__name__} ..."


class Value:
    """Base of the frozen values: checks every declared array and makes it read-only.

    A name such as "n" stands for the same size in all fields of one value.
    Raises InputError that names the type, the field, what was wanted and what came.
    """

    def __init_subclass__(cls) -> None:
        cls.__repr__ = summary  # type: ignore[method-assign]

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        for spec_field in fields(self):  # type: ignore[arg-type]
            spec = spec_field.metadata.get("array")
            given = getattr(self, spec_field.name)
            if spec is None or (given is None and spec_field.default is None):
                continue
            name = f"{type(self).__name__}.{spec_field.name}"
            object.__setattr__(self, spec_field.name, _checked(name, given, spec, sizes))

    def chosen(self, rows: Bool | I64 | slice) -> Self:
        """The same with some of the rows of its first array, and of those that go with it."""
        specs = {each.name: each.metadata.get("array") for each in fields(self)}  # type: ignore[arg-type]
        first = next(spec.shape[0] for spec in specs.values() if spec)
        columns = {
            name: getattr(self, name)[rows]
            for name, spec in specs.items()
            if spec and spec.shape[0] == first and getattr(self, name) is not None
        }
        return replace(self, **columns)  # type: ignore[type-var]


def _checked(name: str, given: Any, spec: ArraySpec, sizes: dict[str, int]) -> npt.NDArray[Any]:
    try:
        with np.errstate(invalid="raise", over="raise"):
            made: npt.NDArray[Any] = np.array(given, dtype=spec.dtype)
    except (TypeError, ValueError, ArithmeticError) as cause:
        raise InputError(f"{name}: wanted numbers, got {given!r:.60}; pass an array") from cause
    _check_shape(name, made.shape, spec.shape, sizes)
    if len(made) < spec.least:
        raise InputError(f"{name}: wanted {spec.least} row or more, got {made.shape}; leave it out")
    if spec.finite and made.dtype.kind == "f" and not np.isfinite(made).all():
        row = int(np.argwhere(~np.isfinite(made))[0][0])
        raise InputError(f"{name}: row {row} is not finite; remove or repair the rows with NaN")
    if made.dtype.kind == "f":
        _check_largest(name, made, spec.largest)
    if spec.covariance:
        _check_covariance(name, made)
    if spec.increasing:
        _check_increasing(name, made)
    if spec.unit_rows and not np.allclose(np.linalg.norm(made, axis=-1), 1.0, atol=1e-3):
        raise InputError(f"{name}: wanted rows of length 1, got others; normalise them")
    made.flags.writeable = False
    return made


def _check_shape(
    name: str, got: tuple[int, ...], wanted: tuple[Dimension, ...], sizes: dict[str, int]
) -> None:
    good = len(got) == len(wanted) and all(
        _size_agrees(size, dimension, sizes) for size, dimension in zip(got, wanted, strict=True)
    )
    if not good:
        text = ", ".join(
            str(dimension) + (f"={sizes[dimension]}" if dimension in sizes else "")
            for dimension in map(str, wanted)
        )
        raise InputError(f"{name}: wanted shape ({text}), got {got}; check the array")


def _size_agrees(size: int, dimension: Dimension, sizes: dict[str, int]) -> bool:
    if isinstance(dimension, int):
        return size == dimension
    match = re.fullmatch(r"([a-z]+)([+-]\d+)?", dimension)
    if match is None:
        raise ValueError(f"dimension {dimension!r} is neither a size nor a name")
    offset = int(match[2] or 0)
    known = sizes.setdefault(match[1], max(size - offset, 0))
    return size == max(known + offset, 0)


def _check_largest(name: str, made: npt.NDArray[Any], largest: float) -> None:
    # Two passes without a copy; NaN is beyond nothing.
    highest, lowest = (each.reduce(made, axis=None, initial=0) for each in (np.fmax, np.fmin))
    if max(highest, -lowest) <= largest:
        return
    row = int(np.argwhere(np.abs(made) > largest)[0][0])
    raise InputError(f"{name}: row {row} is beyond {largest:g}; remove or repair it")


def _check_covariance(name: str, matrices: npt.NDArray[Any]) -> None:
    told = np.flatnonzero(np.isfinite(matrices).all(axis=(-2, -1)))
    known = matrices[told]
    allowed = ROUNDING * np.abs(known).max(axis=(-2, -1), initial=0.0)
    skew = np.abs(known - np.swapaxes(known, -2, -1)).max(axis=(-2, -1), initial=0.0)
    least = np.linalg.eigvalsh(known).min(axis=-1, initial=0.0)
    for wrong, why in ((skew > allowed, "not symmetric"), (least < -allowed, "not positive")):
        if wrong.any():
            row = told[int(np.argmax(wrong))]
            raise InputError(f"{name}: row {row} is no covariance, as it is {why}; make it again")


def _check_increasing(name: str, t: npt.NDArray[Any]) -> None:
    steps = np.diff(t)
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0)) + 1
        kind = "repeats" if steps[row - 1] == 0 else "runs backward"
        raise InputError(
            f"{name}: time {kind} at row {row} ({t[row - 1]:.4f} then {t[row]:.4f} s); "
            "sort the rows and drop the repeated ones"
        )
