"""Processes elsewhere find what these tests plant."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from elfslam.app.workers import Workers, open_workers

HERE = str(Path(__file__).parent)
sys.path.append(HERE)
os.environ["PYTHONPATH"] = os.pathsep.join([os.environ.get("PYTHONPATH", ""), HERE]).strip(":")


@pytest.fixture(scope="module", params=["1", "2", "ray"])
def workers(request: pytest.FixtureRequest) -> Iterator[Workers]:
    """This process, two others, and Ray."""
    if request.param == "ray":
        pytest.importorskip("ray", reason="Ray is not installed")
    with open_workers(request.param) as opened:
        yield opened
