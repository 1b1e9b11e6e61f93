"""Nobody passes without a token of ours, on any route; and nobody may ask too often."""

from __future__ import annotations

import re

import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

from elfslam.serve.people.access import admit, new_token
from elfslam.serve.people.users import add_user
from elfslam.serve.problems import Problem
from elfslam.serve.services import Rates, Services
from elfslam.serve.store.database import looking

BODIES = {"/api/find": {"wifi": {"04:33:89:79:fc:7c": -60}}}
"""What a route wants to see before it looks at the token."""


PUBLIC = {
    "/api/version",
    "/api/key",
    "/api/session/code",
    "/api/links/open",
    "/api/maps/{map_id}/plotly-{version}.min.js",
}


@pytest.mark.parametrize("token", [None, "k" * 43])
def test_every_route_but_the_public_ones_wants_a_token(
    app: FastAPI, anyone: TestClient, token: str | None
) -> None:
    header = {"Authorization": f"Bearer {token}"} if token else {}
    tried = 0
    for path, methods in app.openapi()["paths"].items():
        if not path.startswith("/api/") or path in PUBLIC:
            continue
        for method in methods:
            url = re.sub(r"\{[^}]*\}", "0" * 32, path)
            answer = anyone.request(method, url, headers=header, json=BODIES.get(path))
            assert answer.status_code == 401, (method, path, answer.text)
            tried += 1
    assert tried > 20


@pytest.mark.parametrize("database_url", ["sqlite", "postgresql"], indirect=True)
def test_who_has_a_token_is_admitted_and_counted(services: Services) -> None:
    known = [add_user(services, name)[1] for name in ("one", "two")]
    rates = Rates(0.01, 200.0)
    with looking(services.engine) as connection:
        for token in [*known, known[0]]:
            admit(connection, token, rates)
        with pytest.raises(Problem) as haste:
            admit(connection, known[0], rates)
        admit(connection, known[1], rates)
        with pytest.raises(Problem) as unknown:
            admit(connection, new_token(), rates)
    assert (haste.value.status_code, unknown.value.status_code) == (429, 401)
    assert "Retry-After" in (haste.value.headers or {})
