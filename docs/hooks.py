"""The reference of commands and parameters, written into the site when it is built.

MkDocs loads this file as a hook; the pages in docs/reference/ hold a marker for each table.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from elfslam.app.settings import Settings
from elfslam.base.parameters import rows
from elfslam.cli.app import VERBS, command_of

COMMANDS = "The table of each verb is written here by `make docs`."
PARAMETERS = "The tables are written here by `make docs`."
"""What the pages say in the place of the tables where nobody has built the site."""


def on_page_markdown(markdown: str, **_: Any) -> str:
    """A page with its markers replaced, as MkDocs asks for it."""
    if COMMANDS in markdown:
        markdown = markdown.replace(COMMANDS, "\n".join(map(command_section, VERBS)))
    if PARAMETERS in markdown:
        markdown = markdown.replace(PARAMETERS, parameter_sections())
    return markdown


def command_section(verb: str) -> str:
    """One verb: what it does, how it is written, and its arguments and options."""
    command = command_of(verb)
    kinds: dict[str, list[Any]] = {"argument": [], "option": []}
    for parameter in command.params:
        kinds[parameter.param_type_name].append(parameter)
    usage = " ".join(["elfslam", verb, *(shown_argument(each) for each in kinds["argument"])])
    table = [(f"`{shown_argument(each)}`", meaning(each)) for each in kinds["argument"]]
    table += [(f"`{' '.join(each.opts)}`", meaning(each)) for each in kinds["option"]]
    lines = [f"## {verb}\n", f"{command.help}\n", f"```\n{usage} [OPTIONS]\n```\n"]
    return "\n".join([*lines, *as_table(("what", "meaning"), table), ""])


def shown_argument(argument: Any) -> str:
    return str(argument.metavar or argument.name.upper())


def meaning(parameter: Any) -> str:
    """What an argument or option is, with its default where that says something."""
    text = str(parameter.help or "")
    default = parameter.default
    silent = default is None or default is False or default in ("", ())
    if parameter.required or silent or isinstance(default, list):
        return text
    return f"{text.rstrip('.')}. Default: `{default}`."


def parameter_sections() -> str:
    """Every parameter by group: name, value, unit and meaning."""
    groups: dict[str, list[tuple[str, ...]]] = {}
    for row in rows(Settings()):
        group, _, name = row.name.partition(".")
        groups.setdefault(group, []).append((f"`{name}`", f"{row.value}", row.unit, row.meaning))
    head = ("name", "value", "unit", "meaning")
    return "\n".join(
        "\n".join([f"## {group}\n", *as_table(head, table), ""]) for group, table in groups.items()
    )


def as_table(head: tuple[str, ...], table: Iterable[tuple[str, ...]]) -> list[str]:
    """A table in Markdown."""
    cells = [head, ("---",) * len(head), *table]
    return ["| " + " | ".join(c.replace("|", "\\|") for c in row) + " |" for row in cells]
