"""The learner node's checkpoints: its parameters, and one `Keeper` for the place they name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from rcl_interfaces.msg import SetParametersResult

from iolspi_ros import parameters
from iolspi_ros.core.samples import Array, Observation
from iolspi_ros.errors import InputError
from iolspi_ros.nodes.control_loop import LoopMemory
from iolspi_ros.nodes.journal import NOTHING, Journal, Mark, begun_from_nothing, read
from iolspi_ros.saving.checkpoint import Content
from iolspi_ros.saving.keeper import Keeper, Snapshot
from iolspi_ros.settings import Settings, setting


@dataclass(frozen=True)
class SavingSettings(Settings):
    """Where a learner is saved, and how often."""

    checkpoint: str = setting("", "file to save to, also at the end; empty for none")
    resume: bool = setting(False, "start from the newest whole checkpoint, if there is one")
    checkpoint_updates: int = setting(
        10, "save in the background after so many updates; 0 for never", low=0
    )
    checkpoint_seconds: float = setting(
        10.0, "save in the background after so long [s]; 0.0 for never", low=0.0, high=1e6
    )
    checkpoints_kept: int = setting(3, "how many checkpoints to keep", low=1, high=1000)


@dataclass(frozen=True)
class Flight:
    """What a learner node must know besides its learner to go on bit by bit the same.

    Attributes
    ----------
    loop : LoopMemory
    sums : ndarray
        Of `reports.Reports`.
    due : bool
        An update is to be made before anything is answered.
    ready : bool
        Whether enough was learned to act.
    """

    loop: LoopMemory
    sums: Array
    due: bool
    ready: bool


class Vehicle(Protocol):
    """A vehicle in this process, which goes on from a checkpoint, too."""

    Memory: type[Any]

    def memory(self) -> Any:
        """Where it is; None when that cannot be said."""
        ...

    def recall(self, memory: Any) -> None:
        """Go on from what `memory` gave."""
        ...


class Saving:
    """Parameters of the checkpoints, and who keeps them.

    Parameters
    ----------
    node : managed.ManagedNode
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self.settings = parameters.declare(node, SavingSettings, ("checkpoint",))
        self._first = self.settings.checkpoint
        self._keeper: Keeper | None = None
        self._journal: Journal | None = None
        self._n_dims = 0  # of what is noted; 0 for nothing
        node.add_on_set_parameters_callback(self._check)

    def _check(self, changed: list[Any]) -> SetParametersResult:
        """Let nobody on the network name a file elsewhere."""
        for parameter in changed:
            if parameter.name != "checkpoint" or not parameter.value:
                continue
            folder = _folder(self._first)
            if not self._first or _folder(str(parameter.value)) != folder:
                where = f"files in {folder}" if self._first else "none: it was started without one"
                return SetParametersResult(
                    successful=False, reason=f"checkpoint is {parameter.value}; allowed: {where}"
                )
        return SetParametersResult(successful=True)

    @property
    def wanted(self) -> bool:
        """Whether anything is to be saved."""
        return bool(self._node.get_parameter("checkpoint").value)

    def keeper(self) -> Keeper:
        """Who keeps the checkpoints in the place that the parameter names now.

        Raises
        ------
        InputError
            When there is none, or nothing can be saved there.
        """
        name = str(self._node.get_parameter("checkpoint").value)
        if not name:
            raise InputError("parameter checkpoint is empty; allowed: the path of a file")
        path = Path(name).expanduser()
        if self._keeper is None or self._keeper.path != path:
            keeper = Keeper(path, self.settings.checkpoints_kept, self._say)
            self.close()
            self._keeper = keeper
        return self._keeper

    def _say(self, text: str) -> None:
        self._node.get_logger().warning(text)

    def look_for(self) -> tuple[Path, Content] | None:
        """What to resume from, with words for people; None for nothing."""
        keeper = self.keeper()
        found = keeper.newest()
        if found is None:
            self._say(f"resume: no whole checkpoint at {keeper.path}; starting from nothing")
        return found

    def due(self) -> bool:
        """Whether the next checkpoint is due."""
        s = self.settings
        keeper = self._keeper
        return keeper is not None and keeper.due(s.checkpoint_updates, s.checkpoint_seconds)

    def updated(self) -> None:
        """Count an update."""
        if self._keeper is not None:
            self._keeper.updated()

    def offer(self, snapshot: Snapshot, mark: Mark) -> None:
        """Have a checkpoint written in the background, and note what comes after its mark."""
        keeper = self.keeper()
        saved = keeper.saved > 0.0 and not keeper.failure
        keeper.offer(snapshot)
        self._note_from(mark, saved=saved)

    def save(self, snapshot: Snapshot, mark: Mark) -> str:
        """Write a checkpoint now; where it is, in words."""
        text = self.keeper().save(snapshot)
        self._note_from(mark, saved=True)
        return text

    # ------------------------------------------------------------ what comes between two

    def keep_journal(self, n_dims: int) -> None:
        """Have what is observed between two checkpoints written down from the next one on."""
        self._n_dims = n_dims

    def note(self, observation: Observation) -> None:
        """Write an observation down, if that is wanted."""
        if self._journal is not None:
            self._journal.note(observation)

    def begin_journal(self) -> None:
        """Note what comes from now on, when nothing was learned yet."""
        if self._journal is None:
            self._note_from(NOTHING, saved=False)

    def go_back(self, mark: Mark) -> None:
        """Note what comes after a checkpoint that was loaded, instead of what came before."""
        if self._journal is not None:
            self._note_from(mark, saved=False)

    def observed_since(self, mark: Mark, n_dims: int, *, fresh: bool) -> list[Observation]:
        """What was observed after a checkpoint, or from the beginning, by one that was killed."""
        keeper = self.keeper()
        if fresh:
            keeper.run = begun_from_nothing(keeper.path) or keeper.run
        return read(keeper.path, keeper.run, mark, n_dims)

    def _note_from(self, mark: Mark, *, saved: bool) -> None:
        if self._journal is None and self._n_dims:
            self._journal = Journal(self.keeper().path, self._n_dims, self._say)
        if self._journal is not None:
            self._journal.begin(self.run, mark, saved=saved)

    @property
    def run(self) -> str:
        """Name of the series of checkpoints."""
        return self._keeper.run if self._keeper is not None else ""

    def close(self, *, all_saved: bool = False) -> None:
        """Let others have the place; what was noted is not needed when all of it was saved."""
        if self._journal is not None:
            self._journal.close(needed=not all_saved)
            self._journal = None
        if self._keeper is not None:
            self._keeper.close()
            self._keeper = None

    def condition(self, now: float) -> tuple[dict[str, object], str]:
        """How saving goes, by name, and what is wrong with it; empty for nothing."""
        keeper = self._keeper
        if keeper is None:
            return {"checkpoint": "none"}, ""
        age = f"{now - keeper.saved:.1f} s" if keeper.saved else "none yet"
        values: dict[str, object] = {"checkpoint": keeper.path, "age of the last checkpoint": age}
        if not keeper.failure:
            return values, ""
        offered = f"at the end it goes to {keeper.elsewhere().parent}"
        return values, f"not saved: {keeper.failure}; {offered}"


def _folder(path: str) -> Path:
    return Path(path).expanduser().resolve().parent
