"""The command as a user meets it."""

from collections.abc import Callable

import pytest

from elfslam.cli.app import run


@pytest.fixture
def elfslam(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """Runs the command; gives its exit code and what it said of errors."""

    def ended(*arguments: object) -> tuple[int, str]:
        return run(list(map(str, arguments))), capsys.readouterr().err

    return ended
