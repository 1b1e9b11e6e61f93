"""elfslam parameters."""

from __future__ import annotations

from dataclasses import asdict

from elfslam.app.console import print_rows
from elfslam.app.settings import Settings
from elfslam.base.parameters import load, rows
from elfslam.cli.options import AsJson, ParameterFile, Setting


def parameters(
    parameter_file: ParameterFile = None, setting: Setting = None, as_json: AsJson = False
) -> None:
    """Every parameter, its value, unit and meaning."""
    settings = load(Settings(), parameter_file, setting or [])
    table = [asdict(row) for row in rows(settings)]
    if not as_json:
        table = [{**row, "value": str(row["value"])} for row in table]
    print_rows(table, title="Parameters", as_json=as_json)
