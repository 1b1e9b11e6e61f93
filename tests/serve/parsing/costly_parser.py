"""A parser that costs what it is told to, each kind more than any bound."""

import os
import signal
import tempfile
import time

from elfslam.base.errors import InputError


def parse(what: str, place: str = "") -> object:
    """Do `what`; `place` is a named pipe that hears of it, or a file that is found fault with."""
    if place and what == "wait":
        with open(place, "w") as told:
            told.write(str(os.getpid()))
    match what:
        case "compute":
            while True:
                pass
        case "grow":
            return [bytes(range(256)) * 4096 * k for k in range(1000)]
        case "write":
            with tempfile.TemporaryFile() as file:
                file.write(bytes(2**22))
                file.flush()
        case "crash":
            os.kill(os.getpid(), signal.SIGABRT)
        case "wait":
            time.sleep(3600)
        case "mistake":
            raise LookupError("a bug of ours")
        case "refuse":
            raise InputError(f"{place}: is no plan")
    return what
