"""What autopilots' parameters were before a bridge changed them: a file for each vehicle.

Vehicles are told apart by what they say they are, not by where they were met: a run that comes by
another URL still gives back what one that was killed had changed.
"""

from __future__ import annotations

import datetime
import json
import re
from pathlib import Path
from typing import Any, NamedTuple

from iolspi_ros.folders import atomic_file, state_folder
from iolspi_ros.resources import cache_folder

_CLOSE = 1e-5  # relative difference that a float of 32 bits may make
_OLD = "before_"
"""Beginning of the names of files by URL, as older versions wrote them to the cache."""


class Identity(NamedTuple):
    """Which vehicle it is; `uid` is empty for one that has no unique number."""

    autopilot: str
    system: int
    uid: str = ""

    def __str__(self) -> str:
        return "_".join(filter(None, (self.autopilot, str(self.system), self.uid)))


class Remembered(NamedTuple):
    """Parameters of one vehicle: as they were, and as a bridge set them."""

    before: dict[str, float]
    changed: dict[str, float]
    url: str = ""
    since: str = ""
    place: Path = Path()


def same(a: float, b: float) -> bool:
    """Whether two values of a parameter are the same number, given 32 bits."""
    return abs(a - b) <= _CLOSE * max(abs(a), abs(b))


class Memory:
    """Files in a folder, one for each vehicle.

    Parameters
    ----------
    folder : Path, optional
        That of the user's state by default.
    old : Path, optional
        Where older versions kept theirs, by URL; the user's cache by default.
    """

    def __init__(self, folder: Path | None = None, old: Path | None = None) -> None:
        self.folder = state_folder() / "autopilots" if folder is None else folder
        self._old = cache_folder() if old is None else old

    def of(self, vehicle: Identity, url: str = "") -> Remembered:
        """What is remembered of a vehicle; what was written by its URL counts where that is all."""
        found = _read(self._path(vehicle))
        if found is not None:
            return found
        old = self._old_path(url, vehicle.system)
        return _read_old(old) or Remembered({}, {})

    def keep(self, vehicle: Identity, url: str, remembered: Remembered) -> None:
        """Write down what was, before it is changed."""
        self.folder.mkdir(parents=True, exist_ok=True)
        now = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
        content = {
            "vehicle": vehicle._asdict(), "url": url, "since": remembered.since or now,
            "before": remembered.before, "changed": remembered.changed,
        }  # fmt: skip
        with atomic_file(self._path(vehicle)) as file:
            file.write(json.dumps(content, indent=1).encode() + b"\n")
        self._old_path(url, vehicle.system).unlink(missing_ok=True)

    def forget(self, vehicle: Identity) -> None:
        """All was given back."""
        self._path(vehicle).unlink(missing_ok=True)

    def all(self) -> list[tuple[Identity, Remembered]]:
        """Every vehicle that is remembered."""
        found = []
        for path in sorted(self.folder.glob("*.json")):
            remembered, about = _read(path), _content(path).get("vehicle", {})
            if remembered is not None:
                found.append((Identity(**about), remembered))
        return found

    def old(self) -> list[Remembered]:
        """What older versions left, by URL."""
        found = [_read_old(path) for path in sorted(self._old.glob(f"{_OLD}*.json"))]
        return [one for one in found if one is not None]

    def _path(self, vehicle: Identity) -> Path:
        return self.folder / f"{vehicle}.json"

    def _old_path(self, url: str, system: int) -> Path:
        name = re.sub(r"[^0-9A-Za-z.]+", "_", f"{url}_{system}")
        return self._old / f"{_OLD}{name}.json"


def _content(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _read(path: Path) -> Remembered | None:
    content = _content(path)
    try:
        return Remembered(
            _numbers(content["before"]), _numbers(content["changed"]), str(content["url"]),
            str(content["since"]), path,
        )  # fmt: skip
    except (KeyError, AttributeError, ValueError, TypeError):
        return None


def _read_old(path: Path) -> Remembered | None:
    """Of before: names and values alone. What they were changed to is not known any more."""
    try:
        before = _numbers(_content(path))
    except (AttributeError, ValueError, TypeError):
        return None
    return Remembered(before, {}, place=path) if before else None


def _numbers(content: Any) -> dict[str, float]:
    return {str(name): float(value) for name, value in content.items()}
