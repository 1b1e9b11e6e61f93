"""The signature of what a webhook is sent: HMAC-SHA256 over the time and the body."""

from __future__ import annotations

import hashlib
import hmac

TIMESTAMP, SIGNATURE = "Elfslam-Timestamp", "Elfslam-Signature"
"""Headers: seconds since 1970, and `sha256=` with the HMAC in hexadecimal."""


def signed_headers(secret: str, timestamp_s: int, body: bytes) -> dict[str, str]:
    """The headers by which a receiver knows that a body is ours, and not an old one."""
    return {TIMESTAMP: str(timestamp_s), SIGNATURE: f"sha256={digest(secret, timestamp_s, body)}"}


def digest(secret: str, timestamp_s: int, body: bytes) -> str:
    """The HMAC-SHA256 of "TIMESTAMP.BODY", in hexadecimal."""
    told = f"{timestamp_s}.".encode() + body
    return hmac.new(secret.encode(), told, hashlib.sha256).hexdigest()
