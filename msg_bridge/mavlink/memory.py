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
        """What is remembered of a vehicle; what was written by its URL counts where that is all.

        So does what was written when it did not tell its number, or when it told it and does not
        now: of a vehicle that was not meant, no parameter has the value that a bridge set.
        """
        for path in (self._path(vehicle), self._other_path(vehicle)):
            found = None if path is None else _read(path)
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
        other = self._other_path(vehicle)
        with atomic_file(self._path(vehicle)) as file:
            file.write(json.dumps(content, indent=1).encode() + b"\n")
        if other is not None:
            other.unlink(missing_ok=True)
        self._old_path(url, vehicle.system).unlink(missing_ok=True)

    def forget(self, vehicle: Identity) -> None:
        """All was given back."""
        for path in (self._path(vehicle), self._other_path(vehicle)):
            if path is not None:
                path.unlink(missing_ok=True)

    def all(self) -> list[tuple[Identity, Remembered]]:
        """Every vehicle that is remembered."""
        found = []
        for path in sorted(self.folder.glob("*.json")):
            remembered, vehicle = _read(path), _vehicle(_content(path).get("vehicle"))
            if remembered is not None and vehicle is not None:
                found.append((vehicle, remembered))
        return found

    def damaged(self) -> list[Path]:
        """Files that tell nothing."""
        whole = {remembered.place for _, remembered in self.all()}
        return [path for path in sorted(self.folder.glob("*.json")) if path not in whole]

    def old(self) -> list[Remembered]:
        """What older versions left, by URL."""
        found = [_read_old(path) for path in sorted(self._old.glob(f"{_OLD}*.json"))]
        return [one for one in found if one is not None]

    def _path(self, vehicle: Identity) -> Path:
        return self.folder / f"{vehicle}.json"

    def _other_path(self, vehicle: Identity) -> Path | None:
        """Of the same vehicle without its number, or of the only one like it with one."""
        nameless = vehicle._replace(uid="")
        if vehicle.uid:
            return None if self._path(vehicle).exists() else self._path(nameless)
        if self._path(vehicle).exists():
            return None
        found = list(self.folder.glob(f"{nameless}_*.json"))
        return found[0] if len(found) == 1 else None

    def _old_path(self, url: str, system: int) -> Path:
        name = re.sub(r"[^0-9A-Za-z.]+", "_", f"{url}_{system}")
        return self._old / f"{_OLD}{name}.json"


def _content(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _vehicle(about: Any) -> Identity | None:
    """Which vehicle a file is about; None when it does not say."""
    try:
        found = Identity(**about)
    except TypeError:
        return None
    kinds = tuple(type(value) for value in found)
    return found if kinds == (str, int, str) else None


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
