"""Compiled functions that are kept on disk where that is possible, and run where it is not."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache


class _Cache(FunctionCache):  # type: ignore[misc]
    """What a full disk does not take is compiled again the next time."""

    def save_overload(self, sig: Any, data: Any) -> None:
        with contextlib.suppress(OSError):
            super().save_overload(sig, data)


def cached_njit(**options: Any) -> Callable[[Any], Any]:
    """As numba's njit(cache=True), which ends the process when it cannot write its cache."""

    def compiled(function: Any) -> Any:
        found = njit(**options)(function)
        # Without any folder to keep it in, numba raises this; then it is not kept.
        with contextlib.suppress(RuntimeError):
            found._cache = _Cache(function)
        return found

    return compiled
