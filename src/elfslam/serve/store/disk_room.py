"""Room on the disk: how its lack shows, and a refusal before all of it is taken."""

from __future__ import annotations

import errno
import os
from pathlib import Path

FULL_ERRORS = (errno.ENOSPC, errno.EDQUOT)


def refuse_full_disk(place: int | Path, size_bytes: int, free_bytes: int) -> None:
    """Raise OSError ENOSPC where writing would leave less than `free_bytes`."""
    disk = os.statvfs(place)
    if disk.f_bavail * disk.f_frsize - size_bytes < free_bytes:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
