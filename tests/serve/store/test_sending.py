"""Blobs as responses."""

from __future__ import annotations

import pytest

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
