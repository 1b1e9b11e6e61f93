"""elfslam locate."""

from pathlib import Path
from typing import Annotated

import typer

from elfslam.app.console import print_rows, progress_bar
from elfslam.app.locate import locate_from
from elfslam.app.settings import Settings
from elfslam.base.enums import Mode, parse_modalities
from elfslam.base.errors import NoAnswerError
from elfslam.base.parameters import load
from elfslam.base.values import FixStatus
from elfslam.cli.options import AsJson, Force, ParameterFile, Setting
from elfslam.data.atomic_files import new_file
from elfslam.data.position_files import write_fixes


def locate_command(
    recording: Annotated[Path, typer.Argument(help="The recording to be located.")],
    floor_map: Annotated[Path, typer.Argument(metavar="MAP", help="A run folder.")],
    out: Annotated[Path, typer.Argument(metavar="OUT.csv", help="Where the fixes go.")],
    by: Annotated[
        str | None, typer.Option(help="wifi, or wifi,magnetic: in a map merged by them.")
    ] = None,
    encoder: Annotated[str | None, typer.Option(help="Default: the one beside the map.")] = None,
    mode: Annotated[
        Mode, typer.Option(help="From 0.6 s of sound, from 8 footsteps, or as one walks.")
    ] = Mode.ONE_SHOT,
    seed: Annotated[int, typer.Option(help="Of the tracker's draws.")] = 0,
    phone_walk: Annotated[
        Path | None, typer.Option(help="A walk of this phone in the map, to learn how it hears.")
    ] = None,
    force: Force = False,
    parameter_file: ParameterFile = None,
    setting: Setting = None,
    as_json: AsJson = False,
) -> None:
    """Locate a recording in a map: where it was, how surely, and where that cannot be said."""
    settings = load(Settings(), parameter_file, setting or [])
    new = new_file(out, overwrite=force, reads=[recording, floor_map])
    with new as partial, progress_bar() as announce:
        announce("locating", None)
        fixes = locate_from(
            recording, floor_map, settings, by=parse_modalities(by), encoder=encoder, mode=mode,
            seed=seed, phone_walk=phone_walk,
        )  # fmt: skip
        write_fixes(fixes, partial)
    counts = {status.name: int((fixes.status == status).sum()) for status in FixStatus}
    print_rows(
        [{"fixes": len(fixes.t_s), **counts}], title=f"Located in {floor_map}", as_json=as_json
    )
    if counts["OK"] == 0:
        raise NoAnswerError(f"{recording}: nowhere in {floor_map}; is it the same place?")
