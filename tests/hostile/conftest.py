"""One loaded process and one set of whole inputs for all hostile files."""

from collections.abc import Iterator
from pathlib import Path

import pytest
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
