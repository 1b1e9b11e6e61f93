"""How the simulator's inner loops are compiled."""

from collections.abc import Callable
from typing import Any

import numba


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function as machine code that holds no lock of Python and allocates nothing.

    Scenes travel as tuples of many arrays. With references counted (`_nrt`) the same code is
    fifteen times slower, and where functions are called in place of inlined, three times.
    """
    options = {"_nrt": False, "forceinline": True}
    compiled = numba.njit(cache=True, fastmath=True, nogil=True, **options)(function)
    return compiled  # type: ignore[no-any-return]
