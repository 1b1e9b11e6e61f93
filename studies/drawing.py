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

from elfslam.base.arrays import F64, I64
from elfslam.base.errors import InputError
from studies.render import select
from studies.results import RESULTS, Result, read_results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH_IN = 5.6
ROW_IN, HEAD_IN, CURVES_IN = 0.24, 0.85, 3.2
TRACE_IN, TILE_IN = 0.55, 0.08
LEVELS = 6
"""Shades of a matrix."""
FEW = 20
"""Points of a curve below which each is a dot."""
RETURNS = "returns"
"""The method whose conditions are marked in traces."""
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
    the number that a condition begins with; `traces`: the same, each in a strip of its own, with an
    upright where the method is "returns". `matrix`: tiles over the number that a condition begins
    with, and its second one or, where there is none, a line for each of `rows`. `points` and
    `paths`: a point for each condition at the two metrics that are shown, or at the one metric over
    the condition's number; a colour for each of `rows`, of a condition what comes before its comma.
    All have a panel for each of `panels`.
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
            look = "o-" if len(points) < FEW else "-"
            values = [each.value for each in points]
            axis.plot(x, values, look, color=color, label=name, markersize=4, linewidth=1.2)
            if all(each.low is not None and each.high is not None for each in points):
                low, high = ([getattr(each, end) for each in points] for end in ("low", "high"))
                axis.fill_between(x, low, high, color=color, alpha=0.15, linewidth=0)
            theirs = [(_number(each.condition), each.paper) for each in points if each.paper]
            if theirs:
                axis.plot(*zip(*theirs, strict=True), "D", color=PAPER_COLOR, fillstyle="none")
        axis.set_title(panel.replace("_", " "))
        axis.set_xscale("log" if wanted.logarithmic else "linear")
    if min(each.value for each in results) >= 0:
        axes[0].set_ylim(bottom=0)
    axes[0].set_ylabel(wanted.y_title)
    figure.supxlabel(wanted.x_title, fontsize=9.5)
    _legend(figure, axes[0])
    return figure


def _legend(figure: Figure, axis: Axes) -> None:
    """Above the panels, where there is more than one name."""
    handles, labels = axis.get_legend_handles_labels()
    if len(labels) > 1:
        figure.legend(handles, labels, loc="outside upper center", ncols=3, markerscale=1.5)


def _traces(results: Sequence[Result], wanted: Drawing) -> Figure:
    from matplotlib.figure import Figure

    rows = _panels(results, wanted.rows)
    returns = [_number(each.condition) for each in rows.pop(RETURNS, ())]
    figure = Figure(figsize=(WIDTH_IN, HEAD_IN + TRACE_IN * len(rows)))
    axes = np.atleast_1d(figure.subplots(len(rows), 1, sharex=True))
    for axis, (name, points) in zip(axes, rows.items(), strict=True):
        for at in returns:
            axis.axvline(at, color=PAPER_COLOR, linewidth=0.8)
        x = [_number(each.condition) for each in points]
        axis.plot(x, [each.value for each in points], color=_color(name), linewidth=1)
        axis.set_title(name, loc="left", pad=2)
        axis.locator_params(axis="y", nbins=2)
    figure.supxlabel(wanted.x_title, fontsize=9.5)
    return figure


def _matrix(results: Sequence[Result], wanted: Drawing) -> Figure:
    panels = _panels(results, wanted.panels)
    lines = max(len(_tiles(some, wanted.rows)[1]) for some in panels.values())
    figure, axes = _axes(len(panels), HEAD_IN + max(1.0, TILE_IN * lines), sharey=True)
    for axis, (panel, some) in zip(axes, panels.items(), strict=True):
        across, up, tiles = _tiles(some, wanted.rows)
        low, high = np.nanquantile(tiles, (0.02, 0.98))
        levels = np.nan_to_num(np.clip((tiles - low) / max(high - low, 1e-9), 0, 1) * LEVELS)
        for (y, first), (length, level) in _runs(np.rint(levels).astype(int)).items():
            axis.broken_barh(
                [(first, length)], (y, 1), facecolor=OURS, alpha=level / LEVELS, linewidth=0
            )
        axis.set_title(panel.replace("_", " "))
        axis.grid(visible=False)
        axis.set_xlim(0, len(across))
        axis.set_ylim(0, len(up))
        ticks = np.linspace(0, len(across) - 1, 3).astype(int)
        axis.set_xticks(ticks + 0.5, [f"{across[k]:g}" for k in ticks])
    marks = range(len(up)) if isinstance(up[0], str) else np.linspace(0, len(up) - 1, 3).astype(int)
    names = [up[k] if isinstance(up[k], str) else f"{up[k]:g}" for k in marks]
    axes[0].set_yticks([k + 0.5 for k in marks], names)
    axes[0].set_ylabel(wanted.y_title)
    figure.supxlabel(wanted.x_title, fontsize=9.5)
    return figure


def _tiles(results: Sequence[Result], rows: str) -> tuple[list[float], list[Any], F64]:
    """What is across and upward, and the values (upward, across)."""
    places = [_numbers(each.condition) for each in results]
    two = all(len(place) > 1 for place in places)
    y = [place[1] if two else str(getattr(each, rows))
         for place, each in zip(places, results, strict=True)]  # fmt: skip
    across: list[float] = sorted({place[0] for place in places})
    up: list[Any] = sorted(set(y)) if two else list(dict.fromkeys(y))[::-1]
    tiles = np.full((len(up), len(across)), np.nan)
    for place, at, each in zip(places, y, results, strict=True):
        tiles[up.index(at), across.index(place[0])] = each.value
    return across, up, tiles


def _runs(levels: I64) -> dict[tuple[int, int], tuple[int, int]]:
    """By row and first column, the length and level of what has one level beside each other."""
    found: dict[tuple[int, int], tuple[int, int]] = {}
    for y, line in enumerate(levels):
        edges = np.concatenate([[0], np.flatnonzero(np.diff(line)) + 1, [len(line)]])
        for first, last in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            if line[first] > 0:
                found[y, first] = (last - first, int(line[first]))
    return found


def _points(results: Sequence[Result], wanted: Drawing) -> Figure:
    return _placed(results, wanted, {"marker": "o", "markersize": 2.5, "linestyle": "none"})


def _paths(results: Sequence[Result], wanted: Drawing) -> Figure:
    return _placed(results, wanted, {"linewidth": 1.2})


def _placed(results: Sequence[Result], wanted: Drawing, look: Mapping[str, Any]) -> Figure:
    panels = _panels(results, wanted.panels)
    figure, axes = _axes(len(panels), CURVES_IN if len(panels) < 4 else CURVES_IN / 2)
    for axis, (panel, some) in zip(axes, panels.items(), strict=True):
        groups: dict[str, dict[str, list[Result]]] = {}
        for each in some:
            name = str(getattr(each, wanted.rows)).split(",")[0]
            groups.setdefault(name, {}).setdefault(each.condition, []).append(each)
        for color, (name, places) in zip(MORE, groups.items(), strict=False):
            xy = [
                (at[0].value, at[1].value) if len(at) > 1 else (_number(place), at[0].value)
                for place, at in places.items()
            ]
            axis.plot(*zip(*xy, strict=True), color=color, label=name, **look)
        axis.set_title(panel.replace("_", " "))
        axis.set_aspect("equal", adjustable="datalim")
        axis.locator_params(nbins=3)
    axes[0].set_ylabel(wanted.y_title)
    figure.supxlabel(wanted.x_title, fontsize=9.5)
    _legend(figure, axes[0])
    return figure


def _numbers(condition: str) -> list[float]:
    return [float(each) for each in re.findall(r"[-+]?[0-9]+(?:\.[0-9]+)?", condition)]


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
    "traces": _traces,
    "matrix": _matrix,
    "points": _points,
    "paths": _paths,
}
