"""The reference of commands, parameters and studies, written into the site when it is built.

MkDocs loads this file as a hook; the pages in docs/reference/ hold a marker for each table.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable
from typing import Any

from elfslam.app.settings import Settings
from elfslam.base.parameters import rows
from elfslam.cli.app import VERBS, command_of
from studies.catalogue import STUDIES, module_of
from studies.results import ROOT

COMMANDS = "The table of each verb is written here by `make docs`."
PARAMETERS = "The tables are written here by `make docs`."
STUDY_TABLE = "The table of studies is written here by `make docs`."
"""What the pages say in the place of the tables where nobody has built the site."""


def on_page_markdown(markdown: str, **_: Any) -> str:
    """A page with its markers replaced, as MkDocs asks for it."""
    if COMMANDS in markdown:
        markdown = markdown.replace(COMMANDS, "\n".join(map(command_section, VERBS)))
    if PARAMETERS in markdown:
        markdown = markdown.replace(PARAMETERS, parameter_sections())
    if STUDY_TABLE in markdown:
        markdown = markdown.replace(STUDY_TABLE, study_table(STUDIES))
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


def study_table(names: Iterable[str]) -> str:
    """Every study by name: its question, and its minutes on two cores."""
    return "\n".join(as_table(("study", "question", "minutes"), map(study_row, names)))


def study_row(name: str) -> tuple[str, str, str]:
    """Read from the code of a study, so that what it needs need not be installed."""
    file = ROOT / f"{module_of(name).replace('.', '/')}.py"
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Study":
            (minutes,) = (each.value for each in node.keywords if each.arg == "minutes")
            return f"`{name}`", str(ast.literal_eval(node.args[0])), ast.unparse(minutes)
    return f"`{name}`", "", ""


def as_table(head: tuple[str, ...], table: Iterable[tuple[str, ...]]) -> list[str]:
    """A table in Markdown."""
    cells = [head, ("---",) * len(head), *table]
    return ["| " + " | ".join(c.replace("|", "\\|") for c in row) + " |" for row in cells]
