"""A phone's browser that is closed and opened again."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.serve.pages.conftest import ARGUMENTS, Pocket


@pytest.fixture
def pocket(play: Any, tmp_path: Path) -> Iterator[Pocket]:
    """A phone that was just handed over; whatever its pages throw fails the test."""
    # Tests evaluate text; that the pages allow none is tested with the pages.
    handed = Pocket(play, tmp_path / "profile", {"args": [*ARGUMENTS], "bypass_csp": True})
    yield handed
    assert handed.problems == []
