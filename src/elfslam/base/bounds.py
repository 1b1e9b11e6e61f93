"""How much a file from outside may claim to hold, before anything is made of the claim.

A few bytes can claim any number of others: sizes in headers cost nothing, and silence packs a
thousandfold. So what is believed grows with the file, and ends where a machine of today does.
"""

from pathlib import Path

from elfslam.base.errors import InputError

MEBIBYTE = 2**20
MOST_BYTES = 2048 * MEBIBYTE
"""No file from outside becomes more than this."""
FREE_BYTES = 64 * MEBIBYTE
"""Any file may claim these."""
RATIO = 100
"""And so many for each byte that it has: honest files hold fewer."""
FARTHEST_M = 1e8
"""No coordinate is larger: those of a country's grid are, with the number of their zone, less."""


def most_bytes(file_bytes: int) -> int:
    """How much a file of so many bytes may claim to hold."""
    return min(MOST_BYTES, FREE_BYTES + RATIO * file_bytes)


def check_claim(source: Path | str, what: str, claimed_bytes: float, file_bytes: int) -> None:
    """Refuse a claim beyond `most_bytes`. Raises InputError."""
    most = most_bytes(file_bytes)
    # NaN fails the comparison.
    if not claimed_bytes <= most:
        raise InputError(
            f"{source}: {what} claims {claimed_bytes:.4g} bytes, wanted at most {most:.4g} of a "
            f"file of {file_bytes}; it is damaged, or cut it in parts"
        )
