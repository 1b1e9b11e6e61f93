"""One command, thin verbs. Nothing is imported here: that takes seconds, which Ctrl-C may end."""

from __future__ import annotations

import atexit
import os
import signal
import sys
import threading
import warnings
from io import TextIOWrapper
from types import FrameType

INTERRUPTED = 130
AGAIN_S = 0.01


def main() -> None:
    """The `elfslam` command. Ctrl-C ends it in silence at any moment, once it has tidied up."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by whoever started this
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w"))
    if isinstance(sys.stdout, TextIOWrapper):  # names may hold what the locale has no bytes for
        sys.stdout.reconfigure(errors="backslashreplace")
    atexit.register(_on_interrupt, signal.SIG_IGN)  # the last thing: all has been done by then
    _on_interrupt(_end)
    from elfslam.app.console import say_what_is_logged
    from elfslam.cli.app import run

    say_what_is_logged()
    code = INTERRUPTED
    try:
        _on_interrupt(_unwind)
        code = run(sys.argv[1:])
    except BaseException:
        if not _is_interrupted():
            raise
    if _is_interrupted():
        os._exit(INTERRUPTED)  # nobody waits for threads, and nothing else is said
    _on_interrupt(_end)
    sys.exit(code)


def _on_interrupt(do: signal._HANDLER) -> None:
    """Leave Ctrl-C alone where whoever started this wants it ignored, as a shell does for `&`."""
    if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
        signal.signal(signal.SIGINT, do)


def _is_interrupted() -> bool:
    return signal.getsignal(signal.SIGINT) in (_overhear, _end)


def _end(number: int, frame: FrameType | None) -> None:
    """There is nothing to tidy up."""
    os._exit(INTERRUPTED)


def _unwind(number: int, frame: FrameType | None) -> None:
    """Tidy up on the way out; what breaks on that way is of no interest."""
    signal.signal(signal.SIGINT, _overhear)
    sys.unraisablehook = lambda hidden: _again(hidden.exc_type)
    sys.excepthook = lambda kind, error, trace: _again(kind)
    warnings.simplefilter("ignore")
    threading.excepthook = lambda _: None
    raise KeyboardInterrupt


def _overhear(number: int, frame: FrameType | None) -> None:
    """Who is impatient, or `timeout`, interrupts twice: that is to spoil no tidying up."""
    signal.signal(signal.SIGINT, _end)


def _again(kind: type[BaseException]) -> None:
    """Interrupt again where that came to a callback or a library that did not pass it on.

    Libraries in C print what they do not pass on, by `sys.excepthook`.
    """
    if issubclass(kind, KeyboardInterrupt):
        signal.signal(signal.SIGINT, _unwind)
        threading.Timer(AGAIN_S, os.kill, (os.getpid(), signal.SIGINT)).start()
