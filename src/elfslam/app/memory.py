"""What a process needs before it has anything to work on."""

from __future__ import annotations

import os
import resource

LIMITS = {"ulimit -v": resource.RLIMIT_AS, "ulimit -d": resource.RLIMIT_DATA}
LOADED_BYTES, THREAD_BYTES = 900_000_000, 100_000_000
"""What the libraries take of addresses, and what their threads add for each core."""
MOST_THREADS = 64


def refuse_scarce_memory() -> None:
    """Raise MemoryError where this process may not have what loading the libraries takes.

    OpenBLAS asks again for ever for the memory that it does not get.
    """
    cores = min(len(os.sched_getaffinity(0)), MOST_THREADS)
    wanted = LOADED_BYTES + THREAD_BYTES * cores
    for name, limit in LIMITS.items():
        allowed = resource.getrlimit(limit)[0]
        if resource.RLIM_INFINITY != allowed < wanted:
            raise MemoryError(
                f"got {allowed // 10**6} MB by {name}, wanted {wanted // 10**6} MB for a start"
            )
