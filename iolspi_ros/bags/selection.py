"""What of a bag is wanted: whose messages, of which run, and what its topics are called."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from iolspi_ros.errors import InputError, check_choice, check_range

ROLES = ("task", "state", "reward", "sample", "verdict")


@dataclass(frozen=True)
class Selection:
    """What of a bag is wanted.

    Parameters
    ----------
    vehicle : str
        Namespace of its topics, "/" for the root; empty for the only one.
    run : int
        Counting from 1; 0 for the only one.
    topics : mapping of str to str
        Topics of a role in `ROLES` that are called otherwise.
    """

    vehicle: str = ""
    run: int = 0
    topics: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_range("run", self.run, 0, 10**9)
        for role in self.topics:
            check_choice("a topic's role", role, ROLES)

    def with_card(self, card: Mapping[str, Any]) -> Selection:
        """What the bag's card says, where nobody said otherwise.

        Raises
        ------
        InputError
            When the card says what cannot be.
        """
        topics, run, vehicle = card.get("topics", {}), card.get("run", 0), card.get("vehicle", "")
        if not isinstance(topics, dict) or not all(isinstance(t, str) for t in topics.values()):
            raise InputError(f"topics in the card is {topics!r}; allowed: state: /joint_states")
        if isinstance(run, bool) or not isinstance(run, int) or not isinstance(vehicle, str):
            raise InputError(
                f"run and vehicle in the card are {run!r} and {vehicle!r}; allowed: a number and a "
                "namespace"
            )
        return replace(
            self,
            vehicle=self.vehicle or vehicle,
            run=self.run or run,
            topics={**topics, **self.topics},
        )

    def place(self, topic: str) -> tuple[str | None, str] | None:
        """Whose a topic is, and in which role; None for one that says nothing to us.

        A topic that was named in `topics` is whoever's the others are.
        """
        for role, name in self.topics.items():
            if f"/{topic.strip('/')}" == f"/{name.strip('/')}":
                return None, role
        namespace, _, last = f"/{topic.strip('/')}".rpartition("/")
        if last not in ROLES or last in self.topics:
            return None
        return namespace or "/", last


def select(vehicle: str = "", run: int = 0, topics: Sequence[str] = ()) -> Selection:
    """A selection as commands and parameters say it, topics as "state:=/joint_states".

    Raises
    ------
    InputError
        When a topic is none.
    """
    named = {}
    for text in topics:
        role, given, name = text.partition(":=")
        if text and not (given and name):
            raise InputError(f"topics has {text!r}; allowed: ROLE:=TOPIC, ROLE one of {ROLES}")
        if text:
            named[role] = name
    return Selection(f"/{vehicle.strip('/')}" if vehicle else "", run, named)
