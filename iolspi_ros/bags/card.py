"""The card of a bag: who flew what."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from iolspi_ros.errors import InputError
from iolspi_ros.task import plain

CARD = "card.yaml"


def write_card(path: Path, card: dict[str, Any]) -> None:
    """Write who flew what, beside the messages."""
    (path / CARD).write_text(yaml.safe_dump(card, sort_keys=False, allow_unicode=True))


def read_card(path: Path) -> dict[str, Any]:
    """The card of a bag; empty when it has none.

    Raises
    ------
    InputError
        When there is one and it is no YAML mapping.
    """
    try:
        card = plain.read(path / CARD, "a card")
    except FileNotFoundError:
        return {}
    except InputError as error:
        raise InputError(f"{path / CARD} is not readable: {error}") from None
    if not isinstance(card, dict):
        raise InputError(f"{path / CARD} is not readable; allowed: a YAML mapping, or no card")
    return card
