"""The index of spots of a server, where one was built."""

from __future__ import annotations

from elfslam.serve.buildings.echoes import EchoIndex
from elfslam.serve.services import Services


def index_of(services: Services) -> EchoIndex | None:
    """The index that lies in the data folder, or none."""
    return None
