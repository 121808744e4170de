"""The transitions of a bag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from iolspi_ros import wire
from iolspi_ros.bags.card import read_card
from iolspi_ros.bags.reader import Damage, Record, deserialise, records
from iolspi_ros.bags.selection import Selection
from iolspi_ros.bags.sorting import InterleavedError, Vehicle
from iolspi_ros.core.samples import Sample, Transitions
from iolspi_ros.errors import InputError
from iolspi_ros.task import TaskDescription

EVERYTHING = Selection()


@dataclass(frozen=True)
class Demonstration:
    """What a bag teaches.

    Attributes
    ----------
    path : Path
    samples : list of Sample
        Each (episode, step) once, in order.
    task : TaskDescription
        That they are of.
    card : dict
        Who flew; empty when nobody said.
    notes : list of str
        What was lost, for a person.
    """

    path: Path
    samples: list[Sample]
    task: TaskDescription
    card: dict[str, Any]
    notes: list[str]

    def transitions(self) -> Transitions:
        """The samples without their keys."""
        return Transitions.of([sample.transition for sample in self.samples], self.task.n_dims)


def read_demonstration(
    path: Path, task: TaskDescription, selection: Selection = EVERYTHING
) -> Demonstration:
    """Read the transitions of a bag.

    They are its `sample` messages; a bag without any is searched for `state` and `reward`, and
    transitions are formed from those. Topics are found by the last part of their name.

    Parameters
    ----------
    path : Path
    task : TaskDescription
        The task that it must be of. A bag from before the topic `task` says at most its name.
    selection : Selection
        Whose messages, of which run, and what its topics are called.

    Raises
    ------
    InputError
        When the bag is missing, empty, of another task, has no readable transition, or has several
        vehicles or runs of which nobody chose one.
    """
    card = read_card(path) if path.is_dir() else {}
    if card.get("task", task.name) != task.name:
        raise InputError(f"bag {path} is of task {card['task']!r}; allowed: {task.name!r}")
    chosen, damage = selection.with_card(card), Damage()
    finder = Finder(task, f"bag {path}", chosen)
    for record in records(path, damage):
        finder.take(record)
    flights = finder.flights()
    if not flights:
        why = "; ".join([*finder.complaints, *damage.notes]) or "it holds " + finder.topics()
        raise InputError(
            f"bag {path} has no transition of task {task.name!r}: {why}; allowed: messages on "
            f"sample ({','.join(wire.sample_names(task.names))}), or on state and reward"
        )
    flight = _choose(flights, chosen, path)
    finder.check_task(flight.vehicle)
    gaps = _gaps(flight.samples)
    notes = [*damage.notes, *finder.complaints, *finder.notes]
    if gaps:
        notes.append(f"{gaps} steps inside its episodes are missing")
    return Demonstration(path, flight.samples, task, card, notes)


class Flight(NamedTuple):
    """One run of one vehicle.

    Attributes
    ----------
    vehicle : str
        Namespace of its topics.
    run : int
        From 1.
    samples : list of Sample
    """

    vehicle: str
    run: int
    samples: list[Sample]

    def __str__(self) -> str:
        episodes = len({sample.episode for sample in self.samples})
        return (
            f"vehicle {self.vehicle} run {self.run} ({len(self.samples)} samples of {episodes} "
            "episodes)"
        )


def _choose(flights: list[Flight], chosen: Selection, path: Path) -> Flight:
    """The one flight that is wanted."""
    fitting = [
        flight for flight in flights
        if chosen.vehicle in ("", flight.vehicle) and chosen.run in (0, flight.run)
    ]  # fmt: skip
    if len(fitting) == 1:
        return fitting[0]
    there = "; ".join(map(str, fitting or flights))
    if not fitting:
        raise InputError(
            f"bag {path} has no {f'vehicle {chosen.vehicle} ' * bool(chosen.vehicle)}"
            f"{f'run {chosen.run}' * bool(chosen.run)}; allowed: {there}"
        )
    raise InputError(
        f"bag {path} has several vehicles or runs, which are never mixed: {there}; allowed: "
        "choose one by vehicle and run (--vehicle, --run, or in its card), or divide it with "
        "iolspi demos split"
    )


def numbered_through(demonstrations: Sequence[Demonstration]) -> list[Sample]:
    """Samples of several bags as one: no (episode, step) twice, stamps growing."""
    samples: list[Sample] = []
    for demonstration in demonstrations:
        first = demonstration.samples[0]
        episode, stamp = 0, 0
        if samples:
            episode = samples[-1].episode + 1 - first.episode
            stamp = samples[-1].stamp + 1 - first.stamp
        samples += [
            replace(sample, episode=sample.episode + episode, stamp=sample.stamp + stamp)
            for sample in demonstration.samples
        ]
    return samples


class Finder:
    """Collects what each vehicle said.

    Parameters
    ----------
    task : TaskDescription
    where : str
        For messages.
    selection : Selection
    """

    def __init__(self, task: TaskDescription, where: str, selection: Selection) -> None:
        self._task, self._where, self._selection = task, where, selection
        self._vehicles: dict[str, Vehicle] = {}
        self._described: dict[str | None, list[TaskDescription]] = {}
        self._counts: dict[str, int] = {}
        self._anybodys: list[tuple[str, Record]] = []
        self.complaints: list[str] = []

    def take(self, record: Record) -> None:
        """Take a message."""
        self._counts[record.topic] = self._counts.get(record.topic, 0) + 1
        place = self._selection.place(record.topic)
        if place is None:
            return
        vehicle, role = place
        if role == "task":
            if record.type == "std_msgs/msg/String":
                said = wire.read_task(deserialise(record), self._where)
                self._described.setdefault(vehicle, []).append(said)
        elif vehicle is None:
            self._anybodys.append((role, record))
        else:
            self._give(self._vehicle(vehicle), role, record)

    def _vehicle(self, name: str) -> Vehicle:
        return self._vehicles.setdefault(name, Vehicle(self._task))

    def _give(self, vehicle: Vehicle, role: str, record: Record) -> None:
        try:
            vehicle.take(role, record.topic, deserialise(record), record.data)
        except InterleavedError as error:
            raise InputError(f"{self._where}: {error}") from None
        except InputError as error:
            self._complain(str(error))
        except Exception as error:  # bytes that are no such message
            self._complain(f"a message on {record.topic} is unreadable ({type(error).__name__})")

    def _complain(self, text: str) -> None:
        if len(self.complaints) < 3 and text not in self.complaints:
            self.complaints.append(text)

    def flights(self) -> list[Flight]:
        """Every run of every vehicle that has a transition."""
        if self._anybodys and not self._vehicles:
            self._vehicle(self._selection.vehicle or "/")
        for role, record in self._anybodys:
            for vehicle in self._vehicles.values():
                self._give(vehicle, role, record)
        self._anybodys.clear()
        return [
            Flight(name, run, samples)
            for name, vehicle in sorted(self._vehicles.items())
            for run, samples in vehicle.runs().items()
        ]

    def check_task(self, vehicle: str) -> None:
        """Raise when a vehicle said that its task is another one."""
        for said in (*self._described.get(vehicle, ()), *self._described.get(None, ())):
            said.check_same(self._task, self._where, "the vehicle")

    def described(self) -> TaskDescription | None:
        """A task that somebody said to fly."""
        return next((said for every in self._described.values() for said in every), None)

    @property
    def notes(self) -> list[str]:
        """What was made up or left out, for a person."""
        count = sum(vehicle.differenced for vehicle in self._vehicles.values())
        left_out = sum(vehicle.discarded for vehicle in self._vehicles.values())
        found = []
        if count:
            found.append(
                f"{count} states have no velocity; differences of their positions stand for it"
            )
        if left_out:
            found.append(f"episodes that were not kept are left out: {left_out}")
        return found

    def topics(self) -> str:
        """What the bag holds, in words."""
        return ", ".join(f"{n} on {topic}" for topic, n in self._counts.items()) or "no message"


def _gaps(samples: list[Sample]) -> int:
    """Steps missing between the first and the last of each episode."""
    missing = 0
    for before, after in pairwise(samples):
        if before.episode == after.episode:
            missing += after.step - before.step - 1
    return missing
