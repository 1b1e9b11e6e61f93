"""Requests made up from the OpenAPI description: no mistake, nothing outside the folder."""

import contextlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis.errors import Unsatisfiable
from schemathesis.checks import CHECKS, load_all_checks
from schemathesis.generation import GenerationMode

from tests.serve.conftest import Maps
from tests.serve.planting import plant_floor_map

Start = Callable[..., Any]
EXAMPLES = 2
"""Of each operation, good ones and as many bad ones."""
OFTEN = {"token_requests_per_s": 1e6, "address_requests_per_s": 1e6, "users": 10_000}
KNOWN_STATUSES = {200, 201, 202, 204, 206, 304, 400, 401, 403, 404, 405, 406, 408, 409}
KNOWN_STATUSES |= {421, 410, 411, 412, 413, 414, 415, 422, 423, 431, 460, 503, 507}

load_all_checks()
NOT_IN_THE_SCHEMA = [
    CHECKS.get_one(name)
    for name in ("positive_data_acceptance", "negative_data_rejection", "missing_required_header")
]
"""What JSON Schema cannot say: a header that must be 1.0.0, a text that must be printable."""


@schemathesis.serializer("application/offset+octet-stream")
def piece_of_a_file(_context: object, value: object) -> object:
    """A body as it is."""
    return value if isinstance(value, bytes) else str(value).encode()


def ids(client: httpx.Client) -> dict[str, str]:
    """Real ids by the names of path parameters."""
    recording = client.post("/api/recordings", json={"name": "walk"}).json()["id"]
    headers = {
        "Tus-Resumable": "1.0.0",
        "Upload-Defer-Length": "1",
        "Upload-Metadata": "filename d2Fsay56aXA=",
    }
    place = client.post("/api/uploads", headers=headers).headers["location"]
    return {
        "recording_id": recording,
        "upload_id": place.rpartition("/")[2],
        **part_of_a_map(client),
    }


def part_of_a_map(client: httpx.Client) -> dict[str, str]:
    """A map, if one is left, and a tile of it."""
    maps = [told["id"] for told in client.get("/api/maps").json()]
    for map_id in maps:
        told = client.get(f"/api/maps/{map_id}/package").json()
        return {"map_id": map_id, "sha256": json.loads(told["manifest"])["tiles"][0]["sha256"]}
    return {}


def files_around(folder: Path) -> set[Path]:
    """What lies beside the data folder."""
    return {path for path in folder.parent.iterdir() if path != folder}


@pytest.mark.real
def test_the_description_keeps_its_word(start_server: Start, maps: Maps) -> None:
    server = start_server(**OFTEN)
    package = f"/api/maps/{plant_floor_map(server.data, maps[0])}/package"
    around = files_around(server.data)
    schema = schemathesis.openapi.from_url(f"{server.url}openapi.json")
    tried = 0
    with httpx.Client(base_url=server.url, headers=server.bearer, timeout=30) as client:
        assert client.get(package).status_code == 200
        for found in schema.get_all_operations():
            operation = found.ok()
            if operation.path.endswith("/stream"):  # it ends with the server
                continue
            for mode in (GenerationMode.POSITIVE, GenerationMode.NEGATIVE):
                tried += try_operation(operation, mode, client, server.bearer)
        assert client.get("/api/me").json()["is_owner"] is True
    assert tried > 100
    assert files_around(server.data) == around


def try_operation(
    operation: Any, mode: GenerationMode, client: httpx.Client, bearer: dict[str, str]
) -> int:
    """Call an operation with made-up requests; how many there were."""
    tried = 0

    @given(case=operation.as_strategy(generation_mode=mode))
    @settings(
        max_examples=EXAMPLES,
        phases=[Phase.generate],
        derandomize=True,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )
    def run(case: Any) -> None:
        nonlocal tried
        tried += 1
        wanted = set(case.path_parameters) & {"recording_id", "upload_id", "map_id", "sha256"}
        if wanted and tried % 2:
            known = ids(client)
            case.path_parameters.update({name: known[name] for name in wanted & known.keys()})
        if tried % 3:
            case.headers["Tus-Resumable"] = "1.0.0"
        answer = case.call(headers=bearer)
        assert answer.status_code in KNOWN_STATUSES, (answer.status_code, case.as_curl_command())
        if answer.status_code >= 400 and case.method != "HEAD":
            told = answer.headers["content-type"][0]
            assert told == "application/problem+json", (told, case.as_curl_command())
        case.validate_response(answer, excluded_checks=NOT_IN_THE_SCHEMA)

    with contextlib.suppress(Unsatisfiable):  # what takes no input cannot be asked wrongly
        run()
    return tried
