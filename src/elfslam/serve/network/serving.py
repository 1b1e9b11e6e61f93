"""Answers at sockets until the server is stopped, within bounds of number and time."""

from __future__ import annotations

import gc
import resource
import socket
from collections.abc import Callable, Sequence

import uvicorn
from starlette.types import ASGIApp

from elfslam.base.errors import InputError
from elfslam.serve.network.authority import Certificate
from elfslam.serve.network.timeouts import PatientConfig
from elfslam.serve.network.visitors import CountingListener, Visitors
from elfslam.serve.settings import Limits

STOP_S = 10
"""How long requests that are being answered may go on when the server is stopped."""
KEEP_ALIVE_S = 60
"""A phone that sends a piece now and then keeps its connection."""
AT_ONCE = 4
"""So many connections are accepted before those that are there get their next turn."""


def serve(
    app: ASGIApp,
    sockets: Sequence[socket.socket],
    limits: Limits,
    certificate: Certificate | None,
    stopping: Callable[[], None],
) -> None:
    """Serve until stopped; plain HTTP without a certificate. `stopping` ends what has no end.

    That is spoken to a reverse proxy, at whose one address everybody is: only all are counted.
    """
    of_one = limits.connections if certificate is None else limits.address_connections
    visitors = Visitors(limits.connections, of_one)
    config = PatientConfig(
        visitors,
        limits,
        app=app,
        ws="none",
        log_config=None,  # as everybody else's
        log_level="warning",
        access_log=False,
        server_header=False,
        proxy_headers=certificate is None,
        backlog=AT_ONCE,
        timeout_graceful_shutdown=STOP_S,
        timeout_keep_alive=KEEP_ALIVE_S,
        ssl_certfile=None if certificate is None else certificate.certificate,
        ssl_keyfile=None if certificate is None else certificate.key,
    )
    gc.freeze()  # what is there now stays, and need not be looked through
    secure = certificate is not None
    doors: list[socket.socket] = [
        CountingListener(each, visitors, speaks_tls=secure) for each in sockets
    ]
    StoppingServer(config, stopping).run(sockets=doors)


def allow_open_files(wanted: int) -> None:
    """Let this process open so many files at once. Raises InputError where it may not."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    unlimited = resource.RLIM_INFINITY
    if hard != unlimited and hard < wanted:
        raise InputError(
            f"this process may open {hard} files at once, wanted {wanted} for connections and "
            f"files; allow more, such as with ulimit -n {wanted}"
        )
    if soft != unlimited and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


class StoppingServer(uvicorn.Server):
    """uvicorn's server, which says that it stops before it waits for answers to end."""

    def __init__(self, config: uvicorn.Config, stopping: Callable[[], None]) -> None:
        super().__init__(config)
        self._stopping = stopping

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """As uvicorn does it, streams told to end."""
        self._stopping()
        await super().shutdown(sockets)
