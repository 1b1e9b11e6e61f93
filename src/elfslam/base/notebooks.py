"""How values show themselves in a notebook: a short text, and a drawing on request."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

LONGEST_TEXT = 60


def summary(value: Any) -> str:
    """The name of a dataclass, and of each field its shape or its short text."""
    parts = (
        f"{item.name}: {_told(getattr(value, item.name))}"
        for item in fields(value)
        if getattr(value, item.name) is not None
    )
    return f"{type(value).__name__}({', '.join(parts)})"


def run_summary(run: Any) -> str:
    """What mapping gave, in a line."""
    kept = int((run.trajectory.closure_weights > 0.5).sum())
    return (
        f"Run({run.name!r}, by {run.similarity.kind}: {len(run.trajectory.t_s)} footsteps, "
        f"{kept} of {len(run.closures.i)} closures kept, {run.trajectory.status})"
    )


def _told(value: object) -> str:
    if isinstance(value, np.ndarray):
        return " x ".join(map(str, value.shape)) if value.ndim else str(value)
    text = repr(value)
    return text if len(text) <= LONGEST_TEXT else f"{type(value).__name__} ..."


class Plotted:
    """A value that `elfslam.plot` can draw."""

    def plot(self, truth: Any = None, **besides: Any) -> Any:
        """A Plotly figure of this; see `elfslam.plot`."""
        import elfslam

        return elfslam.plot(self, truth, **besides)  # type: ignore[arg-type]
