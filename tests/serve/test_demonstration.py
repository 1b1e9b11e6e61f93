"""The demonstration building comes and goes in one request, and is what a mapped building is."""

from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from elfslam.serve.services import Services
from elfslam.serve.store.blobs import found_blob
from elfslam.serve.store.tables import MapFile
from elfslam.stages.feature import load_encoder

URL = "/api/demonstration"


@pytest.fixture
def loaded(owner: TestClient) -> dict[str, Any]:
    """The maps of the building, by their names."""
    made = owner.post(URL)
    assert made.status_code == 201, made.text
    return {each["name"]: each for each in made.json()}


def test_it_is_a_building_of_two_floors_and_a_walk_to_be_merged(
    owner: TestClient, loaded: dict[str, Any]
) -> None:
    lower, upper, walk = (
        loaded[name] for name in sorted(loaded, key=lambda name: (len(name), name))
    )
    assert [each["level"] for each in (lower, upper, walk)] == [0, 1, 1]
    assert {each["venue"] for each in loaded.values()} == {"Demonstration building"}
    assert lower["facts"]["frame"] == upper["facts"]["frame"] == lower["id"]
    assert "frame" not in walk["facts"]
    (passage,) = upper["facts"]["passages"]
    assert {passage["from_level"], passage["to_level"]} == {0, 1}
    assert [each["has_link"] for each in (lower, upper, walk)] == [True, False, False]
    picture = owner.get(f"/api/maps/{lower['id']}/floor-plan")
    assert picture.content.startswith(b"\x89PNG")
    points = owner.get(f"/api/maps/{upper['id']}/points-of-interest").json()["points"]
    assert {"Kitchen", "Stairs", "Lift"} <= {each["name"] for each in points}
    assert owner.get(f"/api/maps/{walk['id']}/report.html").status_code == 200


def test_its_features_are_of_the_encoder_that_is_shipped(
    services: Services, loaded: dict[str, Any]
) -> None:
    """Else `python -m studies.demonstration building` is due."""
    for each in loaded.values():
        with services.sessions() as session:
            file = session.get_one(MapFile, (each["id"], "map.npz"))
        with np.load(found_blob(services.settings.blobs_folder, file.sha256)) as arrays:
            (identity,) = arrays["payload_encoders"]
            assert identity.startswith(load_encoder("compact").identity)


def test_it_comes_once_and_goes_whole(owner: TestClient) -> None:
    assert owner.delete(URL).status_code == 404
    owner.post(URL).raise_for_status()
    again = owner.post(URL)
    assert (again.status_code, "there already" in again.json()["detail"]) == (409, True)
    assert owner.delete(URL).status_code == 204
    assert owner.get("/api/maps").json() == []
