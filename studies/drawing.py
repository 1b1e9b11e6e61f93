"""The figures of README and docs: which there are, and how results become an SVG of light and dark.

They are as wide as a phone's screen. Colours are variables of the SVG's style sheet, of which the
reader's browser takes the light or the dark half.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from elfslam.base.errors import InputError
from studies.render import select
from studies.results import RESULTS, Result, read_results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH_IN = 5.6
ROW_IN, HEAD_IN, CURVES_IN = 0.24, 0.85, 3.2
INK, FAINT, OURS, THEIRS, PAPER_COLOR = "#010101", "#020202", "#030303", "#040404", "#050505"
MORE = ("#030303", "#060606", "#070707", "#080808", "#090909", "#0a0a0a")
"""Stand for variables, and are replaced by them; of curves, in the order in which they come."""
VARIABLES = {
    INK: ("ink", "#1f2328", "#e6edf3"), FAINT: ("faint", "#d0d7de", "#3d444d"),
    OURS: ("ours", "#0b6bcb", "#58a6ff"), THEIRS: ("theirs", "#6e7781", "#8d96a0"),
    PAPER_COLOR: ("paper", "#bc4c00", "#f0883e"), MORE[1]: ("second", "#bc4c00", "#f0883e"),
    MORE[2]: ("third", "#1a7f37", "#3fb950"), MORE[3]: ("fourth", "#8250df", "#a371f7"),
    MORE[4]: ("fifth", "#9a6700", "#d29922"), MORE[5]: ("sixth", "#6e7781", "#8d96a0"),
}  # fmt: skip
"""Name, light, dark."""


@dataclass(frozen=True)
class Drawing:
    """What a figure shows of results, and how.

    `dots`: a dot with its interval for each of `rows`; `curves`: a curve for each of `rows`, over
    the number that a condition begins with. Both have a panel for each of `panels`.
    """

    name: str
    study: str
    where: Mapping[str, tuple[str, ...]]
    kind: str
    caption: str
    x_title: str
    y_title: str = ""
    rows: str = "method"
    panels: str = "world"
    logarithmic: bool = False


def svg(drawing: Drawing) -> str:
    """The figure as SVG. Raises InputError where no result fits, or nobody draws such a kind."""
    import matplotlib

    results = select(read_results(RESULTS / f"{drawing.study}.csv"), drawing.where)
    if not results:
        raise InputError(f"figure {drawing.name}: no result of {drawing.study} fits")
    if drawing.kind not in KINDS:
        raise InputError(f"kind={drawing.kind}: wanted {', '.join(KINDS)}")
    with matplotlib.rc_context(STYLE):
        return themed_svg(KINDS[drawing.kind](results, drawing), drawing.caption)


STYLE: Any = {
    "svg.fonttype": "none", "svg.hashsalt": "elfslam", "font.family": "sans-serif",
    "font.size": 9.5, "axes.edgecolor": FAINT, "axes.labelcolor": INK, "text.color": INK,
    "xtick.color": INK, "ytick.color": INK, "xtick.labelcolor": INK, "grid.color": FAINT,
    "axes.titlesize": 9.5, "axes.spines.top": False, "axes.spines.right": False,
    "axes.grid": True, "grid.linewidth": 0.6, "legend.frameon": False, "legend.fontsize": 8.5,
    "figure.constrained_layout.use": True,
}  # fmt: skip
"""Of matplotlib, for every figure of the docs."""


def themed_svg(figure: Figure, title: str) -> str:
    """A figure drawn in the colours above as SVG that is light or dark as its reader is."""
    stream = io.StringIO()
    figure.savefig(stream, format="svg", transparent=True, metadata={"Date": None, "Title": title})
    text = stream.getvalue()
    for stand_in, (variable, _, _) in VARIABLES.items():
        text = text.replace(stand_in, f"var(--{variable})")
    light, dark = (
        "".join(f"--{name}:{colors[k]};" for name, *colors in VARIABLES.values()) for k in (0, 1)
    )
    style = f"<style>svg{{{light}}}@media(prefers-color-scheme:dark){{svg{{{dark}}}}}</style>"
    return re.sub(r"(<svg[^>]*>)", rf"\1{style}", text, count=1)


def _panels(results: Sequence[Result], column: str) -> dict[str, list[Result]]:
    found: dict[str, list[Result]] = {}
    for each in results:
        found.setdefault(str(getattr(each, column)), []).append(each)
    return found


def _axes(count: int, height_in: float, **how: Any) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH_IN, height_in))
    return figure, list(np.atleast_1d(figure.subplots(1, count, **how)))


def _dots(results: Sequence[Result], wanted: Drawing) -> Figure:
    panels = _panels(results, wanted.panels)
    rows = list(dict.fromkeys(str(getattr(each, wanted.rows)) for each in results))
    figure, axes = _axes(len(panels), HEAD_IN + ROW_IN * len(rows), sharey=True)
    for axis, (panel, some) in zip(axes, panels.items(), strict=True):
        for each in some:
            y, color = rows.index(str(getattr(each, wanted.rows))), _color(each.method)
            if each.low is not None and each.high is not None:
                axis.plot([each.low, each.high], [y, y], color=color, linewidth=1.6)
            axis.plot(each.value, y, "o", color=color, markersize=5)
            if each.paper is not None:
                axis.plot(each.paper, y, "D", color=PAPER_COLOR, markersize=5, fillstyle="none")
        axis.set_title(panel.replace("_", " "))
        axis.set_xscale("log" if wanted.logarithmic else "linear")
        if wanted.logarithmic:
            _plain_ticks(axis, some)
        axis.grid(axis="y", visible=False)
    axes[0].set_yticks(range(len(rows)), rows)
    axes[0].set_ylim(len(rows) - 0.5, -0.5)
    figure.supxlabel(wanted.x_title, fontsize=9.5)
    return figure


def _plain_ticks(axis: Axes, results: Sequence[Result]) -> None:
    """Ticks as plain numbers on a logarithmic axis, three at most."""
    values = [v for r in results for v in (r.value, r.low, r.high, r.paper) if v is not None]
    low, high = min(values) / 1.15, max(values) * 1.15
    nice = [m * 10.0**e for e in range(-3, 5) for m in (1, 2, 5) if low <= m * 10.0**e <= high]
    ticks = nice[:: max(1, -(-len(nice) // 3))]
    axis.set_xlim(low, high)
    axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.minorticks_off()


def _curves(results: Sequence[Result], wanted: Drawing) -> Figure:
    panels = _panels(results, wanted.panels)
    figure, axes = _axes(len(panels), CURVES_IN, sharey=True)
    for axis, (panel, some) in zip(axes, panels.items(), strict=True):
        for color, (name, points) in zip(MORE, _panels(some, wanted.rows).items(), strict=False):
            x = [_number(each.condition) for each in points]
            axis.plot(
                x, [each.value for each in points], "o-", color=color, label=name, markersize=4
            )
            if all(each.low is not None and each.high is not None for each in points):
                low, high = ([getattr(each, end) for each in points] for end in ("low", "high"))
                axis.fill_between(x, low, high, color=color, alpha=0.15, linewidth=0)
            theirs = [(_number(each.condition), each.paper) for each in points if each.paper]
            if theirs:
                axis.plot(*zip(*theirs, strict=True), "D", color=PAPER_COLOR, fillstyle="none")
        axis.set_title(panel.replace("_", " "))
        axis.set_ylim(bottom=0)
        axis.set_xscale("log" if wanted.logarithmic else "linear")
    axes[0].set_ylabel(wanted.y_title)
    figure.supxlabel(wanted.x_title, fontsize=9.5)
    handles, labels = axes[0].get_legend_handles_labels()
    if len(labels) > 1:
        figure.legend(handles, labels, loc="outside lower center", ncols=2)
    return figure


def _number(condition: str) -> float:
    found = re.match(r"[-+]?[0-9.]+", condition)
    if found is None:
        raise InputError(f"condition {condition!r}: wanted one that begins with a number")
    return float(found[0])


def _color(method: str) -> str:
    return OURS if method.startswith("ELF") else THEIRS


KINDS: Mapping[str, Callable[[Sequence[Result], Drawing], Figure]] = {
    "dots": _dots,
    "curves": _curves,
}
