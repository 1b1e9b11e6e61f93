"""Where positions arrive and whence they go: the board, the history, MQTT and webhooks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime

from elfslam.serve.people.rates import Rates
from elfslam.serve.positions.board import Board
from elfslam.serve.positions.history_buffer import HistoryBuffer
from elfslam.serve.positions.outboxes import Outboxes
from elfslam.serve.positions.values import LivePosition

Sink = Callable[[Sequence[LivePosition]], None]
"""Takes positions and waits for nobody."""


class PositionHub:
    """The live positions of one server. `rates`: how often a walker may send some."""

    def __init__(self, rates: Rates) -> None:
        self.rates = rates
        self.board, self.history, self.outboxes = Board(), HistoryBuffer(), Outboxes()
        self._sinks: tuple[Sink, ...] = ()

    def take(self, positions: Sequence[LivePosition], *, keep: bool) -> None:
        """Tell everybody who is to know of positions, oldest first; keep them where that is on."""
        self.board.tell(positions)
        if keep:
            self.history.add(positions)
        for sink in self._sinks:
            sink(positions)

    def forget(self, walker: str) -> None:
        """Show a walker no more, and pass on nothing of them that still waits."""
        self.board.leave(walker)
        self.outboxes.forget_walker(walker, datetime.now(UTC))

    @contextmanager
    def feeding(self, sink: Sink) -> Iterator[None]:
        """Somebody more who takes all positions, as long as the block lasts."""
        self._sinks = (*self._sinks, sink)
        try:
            yield
        finally:
            self._sinks = tuple(each for each in self._sinks if each is not sink)
