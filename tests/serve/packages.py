"""Packages of maps as phones fetch them, checked against what is told of them."""

import base64
import hashlib
import json
from typing import Any

import httpx
import pytest
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.utils import encode_dss_signature

Json = dict[str, Any]


def manifest(client: httpx.Client, map_id: str) -> Json:
    """What the server tells of a map, its signature checked."""
    told = client.get(f"/api/maps/{map_id}/package").raise_for_status().json()
    key = client.get("/api/key").json()
    spki = base64.b64decode(key["spki"])
    assert base64.urlsafe_b64decode(key["key"] + "=") == hashlib.sha256(spki).digest()
    check(spki, told["manifest"], told["signature"])
    with pytest.raises(InvalidSignature):
        check(spki, told["manifest"].replace('"format":3', '"format":4'), told["signature"])
    return dict(json.loads(told["manifest"]))


def check(spki: bytes, text: str, signature: str) -> None:
    public, halves = serialization.load_der_public_key(spki), base64.b64decode(signature)
    assert isinstance(public, ec.EllipticCurvePublicKey)
    numbers = (int.from_bytes(half, "big") for half in (halves[:32], halves[32:]))
    public.verify(encode_dss_signature(*numbers), text.encode(), ec.ECDSA(hashes.SHA256()))


def part(client: httpx.Client, map_id: str, told: Json) -> bytes:
    """A part, as it is told."""
    content = client.get(f"/api/maps/{map_id}/package/{told['sha256']}").raise_for_status().content
    assert len(content) == told["size_bytes"]
    assert hashlib.sha256(content).hexdigest() == told["sha256"]
    return content
