"""What every request passes before a route sees it: whence it comes, how large and how often.

And the headers that every response carries.
"""

from __future__ import annotations

import ipaddress
from collections.abc import MutableMapping
from typing import Any
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from elfslam.serve.people.access import refuse_haste
from elfslam.serve.problems import Problem, problem_response
from elfslam.serve.services import Services
from elfslam.serve.settings import Limits

LOCAL_NETWORKS = tuple(
    map(
        ipaddress.ip_network,
        (
            "127.0.0.0/8",
            "10.0.0.0/8",
            "172.16.0.0/12",
            "192.168.0.0/16",
            "169.254.0.0/16",
            "::1/128",
            "fc00::/7",
            "fe80::/10",
        ),
    )
)
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
UPLOADS = "/api/uploads"
TUS_VERSION = "1.0.0"
CONTENT_POLICY = "; ".join(
    (
        "default-src 'self'",
        "script-src 'self' 'wasm-unsafe-eval'",
        "worker-src 'self' blob:",
        "img-src 'self' blob: data:",
        "media-src 'self' blob:",
        "connect-src 'self' blob:",
        "object-src 'none'",
        "base-uri 'none'",
        "form-action 'self'",
        "frame-ancestors 'self'",
    )
)
HEADERS = {
    "Content-Security-Policy": CONTENT_POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": (
        "microphone=(self), accelerometer=(self), gyroscope=(self), magnetometer=(self), "
        "screen-wake-lock=(self), geolocation=(self), camera=()"
    ),
}
"""A route that sets one of these itself keeps its own."""


def is_local(host: str) -> bool:
    """Whether an address is this machine's or of a local network."""
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return False
    mapped = getattr(address, "ipv4_mapped", None) or address
    return any(mapped in network for network in LOCAL_NETWORKS)


class Guard:
    """The ASGI middleware around everything."""

    def __init__(self, app: ASGIApp, services: Services) -> None:
        self._app, self._services = app, services

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        careful = _with_headers(send, scope["path"])
        try:
            _check(scope, self._services)
        except Problem as refusal:
            response = problem_response(
                refusal.status_code,
                refusal.detail,
                {"Connection": "close", **(refusal.headers or {})},
            )
            await response(scope, receive, careful)
            return
        _override_method(scope)
        most = most_bytes(scope["path"], self._services.settings.limits)
        await self._app(scope, _bounded(receive, most), careful)


def _check(scope: Scope, services: Services) -> None:
    headers, settings = Headers(scope=scope), services.settings
    host = scope["client"][0] if scope.get("client") else "127.0.0.1"
    if not (settings.allow_public or is_local(host)):
        raise Problem(403, "this server answers its own network only; come closer")
    refuse_haste(services.address_rates.take(host))
    if scope["method"] not in SAFE_METHODS and not same_origin(headers):
        raise Problem(403, "this was sent by a page of another site; open the server's own page")
    length, most = headers.get("content-length", "0"), most_bytes(scope["path"], settings.limits)
    if not (length.isascii() and length.isdigit()):
        raise Problem(400, f"Content-Length is {length!r:.30}; wanted a number of bytes")
    if int(length) > most:
        raise _too_large(most)


def same_origin(headers: Headers) -> bool:
    """Whether a request was made by one of our own pages, or by no page at all."""
    origin = headers.get("origin")
    if origin is None:
        return headers.get("sec-fetch-site", "none") in ("none", "same-origin")
    try:
        return urlsplit(origin).netloc.lower() == headers.get("host", "").lower() != ""
    except ValueError:
        return False


def most_bytes(path: str, limits: Limits) -> int:
    """How large the body of a request to a path may be."""
    if is_upload(path):
        return limits.file_bytes
    return limits.floor_plan_bytes if path.endswith("/floor-plan") else limits.request_bytes


def is_upload(path: str) -> bool:
    """Whether the tus protocol is spoken at a path."""
    return path == UPLOADS or path.startswith(f"{UPLOADS}/")


def _too_large(most: int) -> Problem:
    return Problem(413, f"the body is too large; at most {most} bytes may be sent here")


def _bounded(receive: Receive, most: int) -> Receive:
    """Receives a body until it is larger than it may be. Raises Problem 413."""
    came = 0

    async def bounded() -> Message:
        nonlocal came
        message = await receive()
        came += len(message.get("body", b""))
        if came > most:
            raise _too_large(most)
        return message

    return bounded


def _override_method(scope: MutableMapping[str, Any]) -> None:
    """What the tus protocol asks for clients that can send GET and POST alone."""
    wanted = Headers(scope=scope).get("x-http-method-override", "").upper()
    if scope["method"] == "POST" and scope["path"].startswith(f"{UPLOADS}/"):
        scope["method"] = wanted if wanted in ("PATCH", "DELETE") else "POST"


def _with_headers(send: Send, path: str) -> Send:
    cached = "no-store" if path.startswith("/api/") else "no-cache"

    async def careful(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers.setdefault(name, value)
            headers.setdefault("Cache-Control", cached)
            if is_upload(path):
                headers.setdefault("Tus-Resumable", TUS_VERSION)
        await send(message)

    return careful
