"""Studies take seconds to minutes each: their tests are real ones, those of single figures not."""

from collections.abc import Iterator
from pathlib import Path

import pytest

HERE = Path(__file__).parent


@pytest.fixture(scope="session", autouse=True)
def nothing_kept() -> Iterator[None]:
    """Tests leave nothing in the cache of whoever runs them, and take nothing from there."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ELFSLAM_CACHE", "")
        yield


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """This hook is given the tests of other folders, too."""
    for item in items:
        if item.path.parent == HERE:
            item.add_marker("real")
