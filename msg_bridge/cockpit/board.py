"""What is shown, in parts; each has a version, so that a browser is sent only what is new."""

from __future__ import annotations

import json
import math
import threading
from typing import Any


class Board:
    """The newest of each part, as JSON; written by the node, read by the server.

    What a slow browser has missed is replaced, so nothing piles up for it.
    """

    def __init__(self) -> None:
        self._parts: dict[str, tuple[int, Any, str]] = {}
        self._lock = threading.Lock()
        self._version = 0

    def put(self, part: str, content: Any) -> None:
        """Show something in the place of what was there."""
        text = json.dumps({"part": part, "is": finite(content)}, separators=(",", ":"))
        with self._lock:
            self._version += 1
            self._parts[part] = (self._version, content, text)

    def get(self, part: str) -> Any:
        """What is shown there; None for nothing."""
        found = self._parts.get(part)
        return None if found is None else found[1]

    def since(self, version: int) -> tuple[int, list[str]]:
        """What is newer than a version, oldest first, and the version then."""
        with self._lock:
            newer = sorted((v, text) for v, _, text in self._parts.values() if v > version)
            return self._version, [text for _, text in newer]


def finite(content: Any) -> Any:
    """The same with None for what is no number: JSON has no word for it."""
    if isinstance(content, float):
        return content if math.isfinite(content) else None
    if isinstance(content, dict):
        return {key: finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [finite(value) for value in content]
    return content
