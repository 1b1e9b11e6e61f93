"""Ctrl-C and SIGTERM end a command in silence at any moment, once it has tidied up.

Nothing else is imported here: that takes seconds, which a signal may end.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable
from functools import partial
from types import FrameType

STOPS = (signal.SIGINT, signal.SIGTERM)
AGAIN_S = 0.01


def run_stoppable(command: Callable[[], int]) -> None:
    """Exit with what `command` gives, or as the signal has it that stopped it.

    That is 130 after Ctrl-C. Of SIGTERM the process dies, as one does that does not heed it: 143
    to a shell, and in order to whoever supervises it.
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by whoever started this
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w"))
    atexit.register(_on_stop, signal.SIG_IGN)  # the last thing: all has been done by then
    code = 1
    try:
        _on_stop(_unwind)
        code = command()
    except BaseException:
        if _stopped_by() is None:
            raise
    if (number := _stopped_by()) is not None:
        _leave(number)  # nobody waits for threads, and nothing else is said
    _on_stop(_end)
    sys.exit(code)


def _on_stop(do: signal._HANDLER) -> None:
    """Leave a signal alone where whoever started this wants it ignored, as a shell does for `&`."""
    for number in STOPS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, do)


def _stopped_by() -> int | None:
    """The signal that came first, where one came."""
    handlers = [signal.getsignal(number) for number in STOPS]
    return next((each.args[0] for each in handlers if isinstance(each, partial)), None)


def _leave(number: int) -> None:
    if number == signal.SIGTERM:
        signal.signal(number, signal.SIG_DFL)
        signal.raise_signal(number)
    os._exit(128 + number)


def _end(number: int, frame: FrameType | None) -> None:
    _leave(number)


def _unwind(number: int, frame: FrameType | None) -> None:
    _on_stop(partial(_overhear, number))
    sys.unraisablehook = lambda hidden: _again(number, hidden.exc_type)
    sys.excepthook = lambda kind, error, trace: _again(number, kind)
    warnings.simplefilter("ignore")
    threading.excepthook = lambda _: None
    raise KeyboardInterrupt


def _overhear(first: int, number: int, frame: FrameType | None) -> None:
    """Who is impatient, or `timeout`, interrupts twice: that is to spoil no tidying up."""
    _on_stop(partial(_end_impatiently, first))


def _end_impatiently(first: int, number: int, frame: FrameType | None) -> None:
    _leave(first)


def _again(number: int, kind: type[BaseException]) -> None:
    """Stop again where that came to a callback or a library that did not pass it on.

    Libraries in C print what they do not pass on, by `sys.excepthook`.
    """
    if issubclass(kind, KeyboardInterrupt):
        _on_stop(_unwind)
        threading.Timer(AGAIN_S, os.kill, (os.getpid(), number)).start()
