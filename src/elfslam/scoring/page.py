"""HTML pages: style, panels, tables. Nothing is fetched but a drawing script that lies beside.

A folder holds that script once for all its pages; `self_contained` makes one file of both.
"""

from __future__ import annotations

import html
import os
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from itertools import count
from pathlib import Path

import plotly.graph_objects as go
from plotly.offline import get_plotlyjs_version

from elfslam.base.errors import InputError

STYLE = """
:root { color-scheme: light dark; --page: #f6f6f4; --card: #ffffff; --ink: #22262b;
  --soft: #6b7280; --line: #e4e4e0; --accent: #0f8b8d; }
@media (prefers-color-scheme: dark) { :root { --page: #131619; --card: #1b1f24; --ink: #e6e8ea;
  --soft: #9aa3ad; --line: #2c323a; --accent: #3fb8ba; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", sans-serif; }
main { max-width: 1180px; margin: 0 auto; padding: 28px 20px 48px; }
h1 { font-size: 1.55rem; font-weight: 650; margin: 0; overflow-wrap: anywhere; }
h2 { font-size: 1rem; font-weight: 600; margin: 0 0 2px; }
p.note { color: var(--soft); font-size: .87rem; margin: 0 0 8px; max-width: 75ch; }
header { border-left: 4px solid var(--accent); padding-left: 14px; margin-bottom: 20px; }
header p { color: var(--soft); margin: 2px 0 0; }
.tiles { display: grid; gap: 12px; margin-bottom: 16px;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 150px), 1fr)); }
.tile, .panel { background: var(--card); border: 1px solid var(--line); border-radius: 10px; }
.tile { padding: 10px 14px; }
.tile b { display: block; font-size: 1.3rem; font-weight: 620; overflow-wrap: anywhere; }
.tile span { color: var(--soft); font-size: .82rem; }
.panels { display: grid; gap: 16px;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 460px), 1fr)); }
.panel { padding: 14px 16px 10px; min-width: 0; overflow-x: auto;
  /* A shadow at the side where more of a table waits. */
  background: linear-gradient(to right, var(--card) 40%, transparent) 0 / 40px 100% no-repeat local,
    linear-gradient(to left, var(--card) 40%, transparent) 100% / 40px 100% no-repeat local,
    linear-gradient(to right, rgb(0 0 0 / .3), transparent) 0 / 12px 100% no-repeat scroll,
    linear-gradient(to left, rgb(0 0 0 / .3), transparent) 100% / 12px 100% no-repeat scroll,
    var(--card); }
.panel.wide { grid-column: 1 / -1; }
table { border-collapse: collapse; width: 100%; font-size: .9rem; }
th, td { text-align: left; padding: 5px 12px 5px 0; border-bottom: 1px solid var(--line);
  vertical-align: top; }
thead th { white-space: nowrap; }
.facts td { overflow-wrap: anywhere; }
thead th, tbody th { color: var(--soft); font-weight: 500; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
tbody tr:last-child > * { border-bottom: 0; }
details { margin-top: 16px; } summary { cursor: pointer; font-weight: 600; }
details table { margin-top: 10px; }
.js-plotly-plot g.infolayer text, .js-plotly-plot g.xaxislayer-above text,
.js-plotly-plot g.yaxislayer-above text, .js-plotly-plot g.cartesianlayer text,
.js-plotly-plot g.shapelayer text { fill: var(--soft) !important; }
.js-plotly-plot .legendtext { fill: var(--ink) !important; }
"""

SCRIPT = f"plotly-{get_plotlyjs_version()}.min.js"
"""What draws the figures, by name."""
LINK = re.compile(r'<script src="(plotly-[^"/]+\.min\.js)"></script>')
FIT = f"""<script>
const narrow = document.querySelector("main").clientWidth < 640;
if (window.Plotly) for (const plot of document.querySelectorAll(".js-plotly-plot")) {{
  const aspect = narrow && plot.layout.meta?.aspect;
  const height = Math.min(620, 150 + aspect * (plot.clientWidth - 68));
  if (!aspect) continue;
  plot.parentElement.style.height = `${{height}}px`;
  Plotly.relayout(plot, {{ height }});
}}
if (window.Plotly) dispatchEvent(new Event("resize"));
else document.querySelector("header").insertAdjacentHTML("beforeend",
  "<p>{SCRIPT} is missing beside this page, so figures are not drawn: copy it here, or run " +
  "<code>elfslam show RUN PAGE.html</code>.</p>");
</script>"""
"""Figures were drawn while the page was still short of panels: each takes the width it has now. On
a phone a plan is as high as it is wide there, so that it fills its frame."""
CONFIG = {"responsive": True, "displayModeBar": False}


@dataclass(frozen=True, eq=False)
class Panel:
    """A titled card that holds a figure or ready HTML."""

    title: str
    body: go.Figure | str
    note: str = ""
    wide: bool = False


@dataclass(frozen=True, eq=False)
class Page:
    """What a page shows, top to bottom. All texts are escaped here; `Panel.body` is trusted."""

    title: str
    subtitle: str
    panels: Sequence[Panel]
    tiles: Mapping[str, str] = field(default_factory=dict)
    details: Mapping[str, str] = field(default_factory=dict)


def save_page(path: Path, page: Page) -> None:
    """Write the page, and the drawing script that it links beside it where none lies there yet.

    Raises OSError where that cannot be done.
    """
    path.write_text(rendered(page), encoding="utf-8")
    if not (path.parent / SCRIPT).exists():
        share_script(path.parent)


def self_contained(path: Path) -> str:
    """A saved page as one file: it holds the drawing script that lies beside it.

    Raises InputError where it links none, or one that is missing.
    """
    text = path.read_text(encoding="utf-8")
    link = LINK.search(text)
    if link is None:
        raise InputError(f"{path}: links no drawing script; it is one file, or no page of elfslam")
    script = path.with_name(link[1])
    if not script.is_file():
        raise InputError(f"{path}: wanted {link[1]} beside it, got none; copy it there")
    drawing = script.read_text(encoding="utf-8")
    return f"{text[: link.start()]}<script>{drawing}</script>{text[link.end() :]}"


def script_file() -> Path:
    """The drawing script as it is installed."""
    return Path(str(files("plotly"))) / "package_data" / "plotly.min.js"


def share_script(folder: Path) -> None:
    """Put the drawing script into a folder, whole or not at all."""
    partial = folder / f".{SCRIPT}.{os.getpid()}"
    try:
        shutil.copyfile(script_file(), partial)
        partial.replace(folder / SCRIPT)
    finally:
        partial.unlink(missing_ok=True)


def rendered(page: Page) -> str:
    """The page as HTML that links the drawing script; equal pages give equal text."""
    title, subtitle = html.escape(page.title), html.escape(page.subtitle)
    numbers = count(1)
    panels = "".join(_panel(panel, numbers) for panel in page.panels)
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title><style>{STYLE}</style>"
        f'<script src="{SCRIPT}"></script></head>'
        f"<body><main><header><h1>{title}</h1><p>{subtitle}</p></header>"
        f'{_tiles(page.tiles)}<div class="panels">{panels}</div>'
        f"{''.join(_details(*item) for item in page.details.items())}</main>{FIT}</body></html>\n"
    )


def facts_table(facts: Mapping[str, object]) -> str:
    """A two-column table of names and values."""
    rows = "".join(
        f"<tr><th>{html.escape(str(name))}</th><td>{html.escape(shown(value))}</td></tr>"
        for name, value in facts.items()
    )
    return f'<table class="facts"><tbody>{rows}</tbody></table>'


def rows_table(rows: Sequence[Mapping[str, object]]) -> str:
    """A table with a column per key of the first row; numbers stand right, with two decimals."""
    if not rows:
        return ""
    names = list(rows[0])
    head = "".join(f"<th{_side(rows[0][name])}>{html.escape(name)}</th>" for name in names)
    body = "".join(f"<tr>{''.join(_cell(row[name]) for name in names)}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def shown(value: object) -> str:
    """A value as a person reads it: four digits, a dash for what does not exist."""
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {shown(item)}" for name, item in value.items())
    return str(value)


def _cell(value: object) -> str:
    text = f"{value:.2f}" if isinstance(value, float) else shown(value)
    return f"<td{_side(value)}>{html.escape(text)}</td>"


def _side(value: object) -> str:
    return ' class="number"' if isinstance(value, int | float) or value is None else ""


def _panel(panel: Panel, numbers: Iterator[int]) -> str:
    kind = "panel wide" if panel.wide else "panel"
    note = f'<p class="note">{html.escape(panel.note)}</p>' if panel.note else ""
    body = panel.body
    if not isinstance(body, str):
        body = body.to_html(
            full_html=False, include_plotlyjs=False, config=CONFIG, div_id=f"figure-{next(numbers)}"
        )
    return f'<section class="{kind}"><h2>{html.escape(panel.title)}</h2>{note}{body}</section>'


def _tiles(tiles: Mapping[str, str]) -> str:
    cells = "".join(
        f'<div class="tile"><b>{html.escape(value)}</b><span>{html.escape(name)}</span></div>'
        for name, value in tiles.items()
    )
    return f'<div class="tiles">{cells}</div>' if cells else ""


def _details(title: str, body: str) -> str:
    return f'<details class="panel"><summary>{html.escape(title)}</summary>{body}</details>'
