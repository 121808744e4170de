"""Computing beside the control thread, in a way that an end need not wait for."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import TypeVar

Found = TypeVar("Found")
NAME = "beside"


def beside(compute: Callable[[], Found]) -> Future[Found]:
    """Compute in a thread that a process does not wait for when it ends."""
    found: Future[Found] = Future()

    def run() -> None:
        try:
            found.set_result(compute())
        except BaseException as error:
            found.set_exception(error)

    threading.Thread(target=run, name=NAME, daemon=True).start()
    return found


def finished(found: Future[Found] | None, seconds: float) -> bool:
    """Whether a computation, if there is one, is over within some seconds."""
    return found is None or bool(wait([found], seconds).done)


def computing() -> bool:
    """Whether some computation is still under way in this process."""
    return any(thread.name == NAME for thread in threading.enumerate())
