"""Studies take seconds to minutes each: their tests are real ones, those of single figures not."""

from __future__ import annotations

from pathlib import Path

import pytest

HERE = Path(__file__).parent


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """This hook is given the tests of other folders, too."""
    for item in items:
        if item.path.parent == HERE:
            item.add_marker("real")
