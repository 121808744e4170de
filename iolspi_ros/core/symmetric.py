"""IOLSPI that knows what may be exchanged: one of all images of a state is learned in.

A task that says its symmetries (`task.symmetry`) looks the same from several sides. Every state
is turned to the one of its images that is greatest in its first variables, and what is done
there is turned back. So each sample tells of all its images at once, in an eighth of the states
where there are mirrors in two axes and both may be exchanged, and nothing is learned twice.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.learner import Proceed, Source, always
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.lspi_update import LSPIUpdate
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.samples import Transition, Transitions
from iolspi_ros.core.shield import Shield
from iolspi_ros.errors import InputError
from iolspi_ros.task import TaskDescription

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

MOST = 64
"""Images that a state may have."""


@dataclass(frozen=True, eq=False)
class Group:
    """All that follows from a task's symmetries, the one that changes nothing first.

    Attributes
    ----------
    take : ndarray of int, shape (n_images, n_dims)
        Which variable takes each place.
    sign : ndarray of shape (n_images, n_dims)
    about : ndarray of shape (n_dims,)
        State that stays where it is.
    actions, back : ndarray of int, shape (n_images, n_actions)
        Which action takes the place of each, and which had it.
    """

    take: Integers
    sign: Array
    about: Array
    actions: Integers
    back: Integers

    @classmethod
    def of(cls, task: TaskDescription) -> Group:
        """What the symmetries of a task make together.

        Raises
        ------
        InputError
            When it has none, they have no state in common that stays, or they do not close.
        """
        abouts = {symmetry.about or (0.0,) * task.n_dims for symmetry in task.symmetries}
        if len(abouts) != 1:
            raise InputError(
                f"task {task.name} has {len(task.symmetries)} symmetries, about {len(abouts)} "
                "states; allowed: one or more, all about the same state"
            )
        makers = []
        for symmetry in task.symmetries:
            take, sign = symmetry.places(task.names)
            makers.append((tuple(take), tuple(sign), symmetry.actions))
        still = tuple(range(task.n_dims)), (1.0,) * task.n_dims, tuple(range(task.n_actions))
        found = [still]
        for one in found:  # grows while it is walked through
            for maker in makers:
                both = _after(maker, one)
                if both not in found:
                    found.append(both)
            if len(found) > MOST:
                raise InputError(
                    f"the symmetries of task {task.name} make more than {MOST} images of a state; "
                    "allowed: mirrors and turns that come back to where they began"
                )
        takes, signs, actions = (np.array(part) for part in zip(*found, strict=True))
        return cls(takes, signs, np.array(abouts.pop()), actions, np.argsort(actions, axis=1))

    def image(self, states: Array, which: Integers) -> Array:
        """Images of states, shape (n, n_dims), each by one of the group, shape (n,)."""
        away = states - self.about
        moved = np.take_along_axis(away, self.take[which], axis=1) * self.sign[which]
        found: Array = moved + self.about
        return found

    def greatest(self, states: Array) -> Integers:
        """Which of the group leads each state to its greatest image, shape (n,)."""
        away = states - self.about
        images = away[:, self.take] * self.sign  # (n, n_images, n_dims)
        left = np.ones(images.shape[:2], bool)
        for d in range(images.shape[2]):
            value = np.where(left, images[:, :, d], -np.inf)
            left &= value == value.max(axis=1, keepdims=True)
        return left.argmax(axis=1)

    def nearest(self, states: Array, others: Array, scales: Array) -> Array:
        """Those images of `others` that are nearest to states, both of shape (n, n_dims)."""
        away = (others - self.about)[:, self.take] * self.sign + self.about
        apart = (((away - states[:, None]) / scales) ** 2).sum(axis=2)
        found: Array = away[np.arange(len(states)), apart.argmin(axis=1)]
        return found


def _after(second: Any, first: Any) -> Any:
    """One exchange after another, as (take, sign, actions)."""
    take = tuple(first[0][place] for place in second[0])
    sign = tuple(s * first[1][place] for place, s in zip(second[0], second[1], strict=True))
    return take, sign, tuple(second[2][action] for action in first[2])


@dataclass(frozen=True)
class _Shield(Shield):
    """A shield that sees the way from a state to its next, though both were turned apart."""

    group: Group | None = None

    def learn(self, batch: Transitions, forget_factor: float = 1.0) -> Shield:
        assert self.group is not None
        near = self.group.nearest(batch.state, batch.next_state, self.half)
        return super().learn(replace(batch, next_state=near), forget_factor)


class SymmetricLSPI(OnlineLSPI):
    """`OnlineLSPI` in the greatest images of all states.

    Where the shield is up, its envelope must have the task's symmetries too.
    """

    kernel: ClassVar[Any] = None  # not compiled: it flies step by step

    def __init__(
        self, task: TaskDescription, settings: LSPISettings, rng: np.random.Generator
    ) -> None:
        self.group = Group.of(task)
        super().__init__(task, settings, rng)
        parts = {field.name: getattr(self.shield, field.name) for field in fields(Shield)}
        self.shield = _Shield(**parts, group=self.group)

    def act(self, state: Array, explore: bool = True) -> tuple[int, Source]:
        """Choose an action in the greatest image, and turn it back."""
        which = self.group.greatest(state[None])
        action, source = super().act(self.group.image(state[None], which)[0], explore)
        return int(self.group.back[which[0], action]), source

    def observe(self, transition: Transition) -> bool:
        """Keep the image of one transition."""
        if not 0 <= transition.action < self.task.n_actions:
            return super().observe(transition)
        row = self._turned(Transitions.of([transition], self.task.n_dims))
        return super().observe(
            transition._replace(
                state=row.state[0], action=int(row.action[0]), next_state=row.next_state[0]
            )
        )

    def pretrain(self, demonstrations: Transitions, proceed: Proceed = always) -> LSPIUpdate:
        """Learn from the images of demonstrations."""
        known = (demonstrations.action >= 0) & (demonstrations.action < self.task.n_actions)
        self.dropped += int((~known).sum())
        return super().pretrain(self._turned(demonstrations[known]), proceed)

    def values(self, states: Array, snapshot: Array | None = None) -> Array:
        """Q̂ of every action, shape (n_states, n_actions)."""
        which = self.group.greatest(states)
        values = super().values(self.group.image(states, which), snapshot)
        turned: Array = np.take_along_axis(values, self.group.actions[which], axis=1)
        return turned

    def _turned(self, rows: Transitions) -> Transitions:
        """Transitions between greatest images; an action is turned as the state it was taken in."""
        which, after = self.group.greatest(rows.state), self.group.greatest(rows.next_state)
        return replace(
            rows,
            state=self.group.image(rows.state, which),
            action=self.group.actions[which, rows.action],
            next_state=self.group.image(rows.next_state, after),
        )
