"""All verbs. Exit codes: 0 done, 1 no honest answer, 2 bad input, 130 interrupted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import typer

from elfslam.base.errors import ParameterError
from elfslam.cli import INTERRUPTED
from elfslam.cli.buildings import buildings_command, publish_command, withdraw_command
from elfslam.cli.encoders import card, finetune_command, parameters, pretrain_command
from elfslam.cli.exports import anchor_command, export_command
from elfslam.cli.maps import locate_command, map_command, merge_command
from elfslam.cli.scores import score, show, study
from elfslam.cli.server import invite_command, serve_command
from elfslam.cli.walks import (
    demo,
    import_command,
    marks_command,
    phyphox_command,
    simulate_command,
)
from elfslam.console import DONE, exit_code_of

app = typer.Typer(
    name="elfslam",
    help="Indoor positioning from the sound of a phone.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
VERBS: Mapping[str, Callable[..., None]] = {
    "demo": demo,
    "simulate": simulate_command,
    "import": import_command,
    "phyphox": phyphox_command,
    "marks": marks_command,
    "map": map_command,
    "merge": merge_command,
    "locate": locate_command,
    "score": score,
    "anchor": anchor_command,
    "export": export_command,
    "show": show,
    "study": study,
    "parameters": parameters,
    "pretrain": pretrain_command,
    "finetune": finetune_command,
    "card": card,
    "serve": serve_command,
    "invite": invite_command,
    "publish": publish_command,
    "withdraw": withdraw_command,
    "buildings": buildings_command,
}
for name, verb in VERBS.items():
    app.command(name)(verb)


def run(arguments: Sequence[str]) -> int:
    """The exit code of `elfslam ARGUMENTS`, once it has been run."""
    return exit_code_of(lambda: _run(arguments))


def _run(arguments: Sequence[str]) -> int:
    """The commands; what Typer refuses becomes one line as well."""
    if not arguments:
        app(arguments)
    try:
        return app(arguments, prog_name="elfslam", standalone_mode=False) or DONE
    except (typer.Abort, KeyboardInterrupt):
        return INTERRUPTED
    except Exception as error:
        explain = getattr(error, "format_message", None)
        if explain is None:
            raise
        raise ParameterError(f"{explain()} See elfslam --help") from error
