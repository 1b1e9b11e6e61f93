"""One loaded process and one set of whole inputs for all hostile files; a line of what they did."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from cases import PROPERTY
from forked_commands import Commands, loaded_commands
from whole_inputs import make_inputs


@pytest.fixture(scope="session")
def commands() -> Iterator[Commands]:
    with loaded_commands() as loaded:
        yield loaded


@pytest.fixture(scope="session")
def base(tmp_path_factory: pytest.TempPathFactory, commands: Commands) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    make_inputs(folder, commands)
    return folder


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """The sum over all tests that told of their cases, in one line."""
    reports = [*terminalreporter.getreports("passed"), *terminalreporter.getreports("failed")]
    told = [value for each in reports for name, value in each.user_properties if name == PROPERTY]
    if not told:
        return
    faults = [fault for each in told for fault in each["faults"]]
    counts = {
        name: sum(fault.startswith(start) for fault in faults)
        for name, start in (
            ("tracebacks", "traceback"),
            ("wrong exit codes", "exit code"),
            ("partial output", "partial output"),
        )
    }
    terminalreporter.write_line(
        f"hostile cases: {sum(each['cases'] for each in told)} "
        f"({sum(each['refused'] for each in told)} refused), "
        + ", ".join(f"{name} {count}" for name, count in counts.items())
        + f", other faults {len(faults) - sum(counts.values())}"
        + f", most memory {max(each['peak_bytes'] for each in told) / 1e6:.0f} MB"
    )
