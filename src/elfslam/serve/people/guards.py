"""What every request passes before a route sees it: whence it comes, how large and how often.

And the bounds of its body, and the headers that every response carries.
"""

import asyncio
import time
from collections.abc import Collection, MutableMapping
from typing import Any

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from elfslam.serve.network.addresses import host_of, is_known, is_local, server_names
from elfslam.serve.people.access import refuse_haste
from elfslam.serve.problems import Problem, problem_response
from elfslam.serve.services import Services
from elfslam.serve.settings import Limits
from elfslam.serve.texts import WHOLE


class Body:
    """Receives one body. `silence_s` is how far it may fall behind the slowest pace."""

    def __init__(
        self, receive: Receive, most_bytes: int, silence_s: float, slowest_bytes_per_s: float
    ) -> None:
        self._receive, self._most_bytes = receive, most_bytes
        self._silence_s, self._pace = silence_s, slowest_bytes_per_s
        self._came, self._behind_s, self._more = 0, 0.0, True

    async def receive(self) -> Message:
        """The next piece. Raises Problem 413 and 408; the end of a connection is waited for."""
        begun_s = time.monotonic()
        try:
            async with asyncio.timeout(self._silence_s - self._behind_s if self._more else None):
                message = await self._receive()
        except TimeoutError as error:
            raise Problem(
                408,
                "too little came for too long; go on from the offset of an upload, or try again",
                {"Connection": "close"},
            ) from error
        came = len(message.get("body", b""))
        waited_s = time.monotonic() - begun_s
        self._behind_s = max(0.0, self._behind_s + waited_s - came / self._pace)
        self._more = message.get("more_body", False)
        self._came += came
        if self._came > self._most_bytes:
            raise too_large(self._most_bytes)
        return message


def too_large(most_bytes: int) -> Problem:
    """The refusal of a body that is larger than that."""
    return Problem(413, f"the body is too large; at most {most_bytes} bytes may be sent here")


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
ONLY_HTTPS = "max-age=31536000"
"""Told for names that the server was given alone: browsers keep it for all ports of a name, and of
`localhost` or the machine's own name it would break every other server there."""


class Guard:
    """The ASGI middleware around everything."""

    def __init__(self, app: ASGIApp, services: Services) -> None:
        self._app, self._services = app, services
        self._names = {*map(str.lower, server_names(())), *services.settings.names}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        careful = _with_headers(send, scope, self._services.settings.names)
        try:
            _check(scope, self._services, self._names)
        except Problem as refusal:
            response = problem_response(
                refusal.status_code,
                refusal.detail,
                {"Connection": "close", **(refusal.headers or {})},
            )
            await response(scope, receive, careful)
            return
        _override_method(scope)
        await self._app(scope, _bounded(receive, scope, self._services.settings.limits), careful)


def _check(scope: Scope, services: Services, names: Collection[str]) -> None:
    headers, settings = Headers(scope=scope), services.settings
    peer = scope["client"][0] if scope.get("client") else ""
    if not (settings.allow_public or is_local(peer)):
        raise Problem(403, "this server answers its own network only; come closer")
    refuse_haste(services.address_rates.take(peer))
    host = host_of(headers.get("host", ""))
    if not is_known(host, names):
        raise Problem(
            421, f"this server is not called {host!r:.60}; use its address, or serve with --name"
        )
    if scope["method"] not in SAFE_METHODS and not same_origin(headers, scope["scheme"]):
        raise Problem(403, "this was sent by a page of another site; open the server's own page")
    length, most = headers.get("content-length", "0"), most_bytes(scope["path"], settings.limits)
    if length.startswith("-") or not WHOLE.fullmatch(length):
        raise Problem(400, f"Content-Length is {length!r:.30}; wanted a number of bytes")
    if int(length) > most:
        raise too_large(most)


def same_origin(headers: Headers, scheme: str) -> bool:
    """Whether a request was made by one of our own pages, or by no page at all."""
    origin = headers.get("origin")
    if origin is None:
        return headers.get("sec-fetch-site", "none") in ("none", "same-origin")
    host = headers.get("host", "")
    return host != "" and origin.lower() == f"{scheme}://{host}".lower()


def most_bytes(path: str, limits: Limits) -> int:
    """How large the body of a request to a path may be."""
    if is_upload(path):
        return limits.file_bytes
    return limits.floor_plan_bytes if path.endswith("/floor-plan") else limits.request_bytes


def is_upload(path: str) -> bool:
    """Whether the tus protocol is spoken at a path."""
    return path == UPLOADS or path.startswith(f"{UPLOADS}/")


def _bounded(receive: Receive, scope: Scope, limits: Limits) -> Receive:
    """Receives a body within its bounds; what is safe reads none, and waits for the end only."""
    if scope["method"] in SAFE_METHODS:
        return receive
    most = most_bytes(scope["path"], limits)
    return Body(receive, most, limits.silence_s, limits.slowest_bytes_per_s).receive


def _override_method(scope: MutableMapping[str, Any]) -> None:
    """What the tus protocol asks for clients that can send GET and POST alone."""
    wanted = Headers(scope=scope).get("x-http-method-override", "").upper()
    if scope["method"] == "POST" and scope["path"].startswith(f"{UPLOADS}/"):
        scope["method"] = wanted if wanted in ("PATCH", "DELETE") else "POST"


def _with_headers(send: Send, scope: Scope, names: Collection[str]) -> Send:
    path, secure = scope["path"], scope["scheme"] == "https"
    cached = "no-store" if path.startswith("/api/") else "no-cache"
    lasting = secure and host_of(Headers(scope=scope).get("host", "")) in names

    async def careful(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers.setdefault(name, value)
            headers.setdefault("Cache-Control", cached)
            if lasting:
                headers["Strict-Transport-Security"] = ONLY_HTTPS
            if is_upload(path):
                headers.setdefault("Tus-Resumable", TUS_VERSION)
        await send(message)

    return careful
