"""Which workers somebody means, and whether a cluster answers."""

from __future__ import annotations

import socket

import pytest

from elfslam.app.workers import check_on, why_away
from elfslam.base.errors import InputError


@pytest.mark.parametrize(
    "on", ["0", "-1", "two", "rays", "ray://", "ray://:10001", "ray://host:x", "ray://me:hunter2@h"]
)
def test_who_is_nobody_is_refused(on: str) -> None:
    with pytest.raises(InputError, match=r"wanted a number of processes, ray or ray://") as said:
        check_on(on)
    assert "hunter2" not in str(said.value)


def test_a_cluster_is_away_where_nobody_listens() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        place = f"ray://127.0.0.1:{listening.getsockname()[1]}"
        assert why_away(place) is None
    assert why_away(place) == "Connection refused"
    assert why_away(None) is why_away("2") is why_away("ray") is None
