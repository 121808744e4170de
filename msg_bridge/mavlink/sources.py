"""Who speaks for the vehicle and for the load: one address each, and nobody beside it."""

from __future__ import annotations

from collections import Counter

_SILENT = 2.0  # after so long without a word [s] a system may speak from another address
_NAMED = 20  # addresses that are named one by one


class Sources:
    """The address of each system that matters here.

    The first that speaks for a system has it, and keeps it while it is heard: packets of the
    same system from anywhere else are not believed, but counted and named.

    Attributes
    ----------
    others : Counter of str
        Packets that were not believed, by system and address.
    news : list of str
        What people have not been told yet.
    """

    def __init__(self) -> None:
        self._address: dict[int, str] = {}
        self._heard: dict[int, float] = {}
        self.others: Counter[str] = Counter()
        self.news: list[str] = []

    def of(self, system: int) -> str | None:
        """Where a system speaks from; None when it has not been heard."""
        return self._address.get(system)

    def known(self, address: str) -> bool:
        """Whether somebody who matters speaks from there."""
        return address in self._address.values()

    def admit(self, system: int, address: str, now: float, *, begins: bool) -> bool:
        """Whether a packet of a system counts that came from an address.

        Parameters
        ----------
        system : int
        address : str
        now : float
            [s]
        begins : bool
            It may be the first: only some packets tell who somebody is.
        """
        here = self._address.get(system)
        if address == here:
            self._heard[system] = now
            return True
        if here is not None and now - self._heard[system] <= _SILENT:
            self._count(f"system {system} at {address}", f"system {system} speaks at {here}")
            return False
        if not begins:
            return False
        if here is not None:
            self.news.append(f"system {system} speaks at {address} now, no longer at {here}")
        self._address[system], self._heard[system] = address, now
        return True

    def _count(self, who: str, truth: str) -> None:
        if who not in self.others and len(self.others) >= _NAMED:
            who = "others"
        self.others[who] += 1
        if self.others[who] == 1:
            self.news.append(f"packets of {who} are not believed: {truth}")
