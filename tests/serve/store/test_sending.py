"""Blobs as responses."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from starlette.testclient import TestClient

from elfslam.serve.problems import Problem
from elfslam.serve.services import Services
from elfslam.serve.store import blobs
from elfslam.serve.store.sending import sent_blob


def test_a_blob_that_is_gone_is_a_refusal(services: Services) -> None:
    store = services.settings.blobs_folder
    file = store.parent / "report"
    file.write_bytes(b"content")
    blob = blobs.put(store, file)
    response = sent_blob(services.settings, blob.sha256, "report", "text/html", filename="a")
    assert (response.path, response.media_type) == (
        blobs.blob_path(store, blob.sha256),
        "text/html",
    )
    blobs.blob_path(store, blob.sha256).unlink()
    with pytest.raises(Problem, match="no such report here") as refused:
        sent_blob(services.settings, blob.sha256, "report", "text/html")
    assert refused.value.status_code == 404


def test_a_blob_that_is_a_folder_is_as_one_that_is_gone(
    owner: TestClient, services: Services, put_map: Callable[..., str]
) -> None:
    map_id, store = put_map(owner), services.settings.blobs_folder
    (blob,) = store.glob("*/*")
    blob.unlink()
    blob.mkdir()
    for what in ("report.html", "map.zip", "view", "export/tum", "package"):
        assert owner.get(f"/api/maps/{map_id}/{what}").status_code in (404, 422), what
    assert owner.delete(f"/api/maps/{map_id}").status_code == 204
    assert owner.get(f"/api/maps/{map_id}").status_code == 404
