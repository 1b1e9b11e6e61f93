"""One POST to a webhook: to an address that was checked, in bounded time, following nothing."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Mapping

import h11

from elfslam import __version__
from elfslam.serve.positions.targets import Target

TIMEOUT_S = 10.0
"""From connecting to the status."""
PIECE_BYTES = 4096


class DeliveryError(Exception):
    """A receiver did not take it. `is_final`: asking once more is no use."""

    def __init__(self, line: str, *, is_final: bool = False) -> None:
        super().__init__(line)
        self.is_final = is_final


async def post(
    target: Target,
    address: str,
    body: bytes,
    headers: Mapping[str, str],
    *,
    timeout_s: float = TIMEOUT_S,
    tls: ssl.SSLContext | None = None,
) -> None:
    """Post JSON; any status of 200 to 299 will do. Raises DeliveryError."""
    try:
        async with asyncio.timeout(timeout_s):
            status = await _status(target, address, body, headers, tls)
    except TimeoutError as error:
        raise DeliveryError(f"did not answer in {timeout_s:g} s") from error
    except (OSError, h11.ProtocolError) as error:
        why = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise DeliveryError(f"cannot be reached: {why:.120}") from error
    if not 200 <= status < 300:
        again = status >= 500 or status in (408, 425, 429)
        followed = "; redirects are not followed" if 300 <= status < 400 else ""
        raise DeliveryError(f"answered {status}{followed}", is_final=not again)


async def _status(
    target: Target,
    address: str,
    body: bytes,
    headers: Mapping[str, str],
    tls: ssl.SSLContext | None,
) -> int:
    context = (tls or ssl.create_default_context()) if target.is_secure else None
    name = target.host if target.is_secure else None
    reader, writer = await asyncio.open_connection(
        address, target.port, ssl=context, server_hostname=name
    )
    try:
        connection = h11.Connection(h11.CLIENT)
        for part in (_request(target, body, headers), h11.Data(body), h11.EndOfMessage()):
            writer.write(connection.send(part) or b"")
        await writer.drain()
        while not isinstance(event := connection.next_event(), h11.Response):
            if event is h11.NEED_DATA:
                connection.receive_data(await reader.read(PIECE_BYTES))
            elif isinstance(event, h11.ConnectionClosed):
                raise DeliveryError("closed the connection without an answer")
        return event.status_code
    finally:
        writer.transport.abort()  # what else it says is of no interest


def _request(target: Target, body: bytes, headers: Mapping[str, str]) -> h11.Request:
    told = {
        "Host": target.authority,
        "User-Agent": f"elfslam/{__version__}",
        "Content-Type": "application/json",
        "Content-Length": str(len(body)),
        "Connection": "close",
        **headers,
    }
    return h11.Request(method="POST", target=target.path, headers=list(told.items()))
