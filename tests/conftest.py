"""Which tests need real parts, and the recordings by other people, where they are available."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

from tests import once_more

# Laws are tried on the same examples in every run, however busy the machine is.
settings.register_profile("steady", deadline=None, derandomize=True)
settings.load_profile("steady")

PROJECT_ROOT = Path(__file__).resolve().parents[1]
REAL_PARTS = {
    *("browser", "phone", "pocket", "working_desk"),
    *("origin", "start_server", "running_server", "serve"),
    *("postgresql", "ray", "s3", "mosquitto"),
}
"""Fixtures and parameters by which a test gets a browser, a server process, a job, a database."""


def pytest_addoption(parser: pytest.Parser) -> None:
    once_more.add_option(parser)


def pytest_configure(config: pytest.Config) -> None:
    """What is run once more is decided where all reports come together."""
    if config.getoption("--once-more") and not hasattr(config, "workerinput"):
        config.pluginmanager.register(once_more.OnceMore(), "once-more")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Whoever uses a real part is a test of `make test-real`, and so are the hostile ones."""
    for item in items:
        if parts_of(item) & REAL_PARTS or item.get_closest_marker("hostile"):
            item.add_marker("real")


def parts_of(item: pytest.Item) -> set[str]:
    """The names of a test's fixtures, and of parameters that are words."""
    given = getattr(getattr(item, "callspec", None), "params", {}).values()
    return {*getattr(item, "fixturenames", ()), *(each for each in given if isinstance(each, str))}


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real recordings; skips the test where it is absent."""
    folder = Path(os.environ.get("ELFSLAM_DATA", PROJECT_ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"real recordings are absent: no folder {folder} (set ELFSLAM_DATA)")
    return folder
