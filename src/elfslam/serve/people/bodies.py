"""The body of a request as it comes: no larger than it may be, and no slower."""

from __future__ import annotations

import asyncio
import time

from starlette.types import Message, Receive

from elfslam.serve.problems import Problem


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
