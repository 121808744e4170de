"""A learner at its vehicle: it learns from demonstrations, acts, learns online, and is saved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from std_msgs.msg import Float64MultiArray

from iolspi_ros import parameters, qos, runtime
from iolspi_ros.core.learner import DEFAULT, Learner, Source, Update, learner_class
from iolspi_ros.core.samples import Observation, Transition
from iolspi_ros.errors import InputError
from iolspi_ros.managed import ManagedNode
from iolspi_ros.nodes.computing import Computing
from iolspi_ros.nodes.demonstrations import Demonstrations
from iolspi_ros.nodes.fleet import Fleet
from iolspi_ros.nodes.help import Help
from iolspi_ros.nodes.journal import Mark
from iolspi_ros.nodes.reports import Reports
from iolspi_ros.nodes.saving import Flight, Saving, Vehicle
from iolspi_ros.nodes.unsure import HelpSettings, Visits
from iolspi_ros.process import say
from iolspi_ros.saving import checkpoint
from iolspi_ros.saving.keeper import Snapshot
from iolspi_ros.settings import Settings, setting
from iolspi_ros.task import TaskDescription
from iolspi_ros.vitals import Report

MOMENT = 0.25
"""Seconds of an update that a vehicle in lockstep is answered after, without anything between."""
PATIENCE = 0.5
"""Seconds that what is being computed still gets at the end."""


@dataclass(frozen=True)
class LearningSettings(Settings):
    """What a learner's node adds to the learner."""

    learner: str = setting(DEFAULT, "a registered learner, or module:Class")
    seed: int = setting(0, "of first weights, exploration and ties", low=0)
    wait_for_demonstrations: bool = setting(
        True, "wait for a demonstration and learn from it before acting"
    )
    other_vehicles: tuple[str, ...] = setting(
        ("",), "namespaces of more vehicles of the same task, to fly and learn from besides"
    )
    background: bool = setting(
        False, "answer while an update is computed, from the first one on; without it as soon as a "
        "vehicle does not wait for it",
    )  # fmt: skip
    vehicle_timeout: float = setting(
        0.0, "give up when no vehicle was heard for this long at the start [s]; 0.0 for never",
        low=0.0, high=1e6,
    )  # fmt: skip


class Learning:
    """Controls one vehicle, or several of one task, by what it learns from them and from samples.

    Parameters
    ----------
    node : ManagedNode
        Whose topics it uses, and whose parameters are the learner's settings.
    task : TaskDescription
    settings : LearningSettings
    help_settings : HelpSettings
    saving : Saving
        Where it goes on from, and is saved.
    vehicle : Vehicle, optional
        When it is in this process and to be saved, too.
    local : bool
        The vehicle is in this process: it hands its observations to `respond`.
    may_act : callable
        Whether the node lets it.

    Attributes
    ----------
    core : Learner
    enabled : bool
        Whether it learns online; otherwise it acts greedily.

    Raises
    ------
    InputError
        When a setting or the checkpoint to go on from is none of this learner's.
    """

    def __init__(
        self, node: ManagedNode, task: TaskDescription, settings: LearningSettings,
        help_settings: HelpSettings, saving: Saving, vehicle: Vehicle | None,
        *, local: bool, may_act: Callable[[], bool],
    ) -> None:  # fmt: skip
        self._node, self.settings, self._saving = node, settings, saving
        self._vehicle, self._may_act = vehicle, may_act
        self._class = learner_class(settings.learner)
        self.core = self._make(task, np.random.default_rng([settings.seed, 1]))
        self.enabled = True
        self._ready = False  # to act, as soon as it may
        self._closing = False
        self._while_flying = 0  # samples
        self._due = False  # an update, since before a resume
        self._again = False  # whether it goes through what was observed before a kill
        found = saving.look_for() if saving.settings.resume else None
        self._computing = Computing(self.core)
        self._demonstrations = Demonstrations(task)
        others = settings.other_vehicles
        self._loop = Fleet(node, task, self, settings.vehicle_timeout, local=local, others=others)
        self._alone = not (local or any(others))
        self._reports = Reports(node, self.core)
        self._help = Help(node, task, help_settings)
        self._fresh = found is None
        if found is not None:
            self._resume(*found)
        self._subscriptions = [
            node.create_subscription(Float64MultiArray, "sample", self._on_sample, qos.SAMPLES),
            node.create_subscription(
                Float64MultiArray, "demonstration", self._on_demonstration, qos.LATCHED
            ),
        ]
        self._ready |= not settings.wait_for_demonstrations

    def _make(self, task: TaskDescription, rng: np.random.Generator) -> Learner:
        return self._class(task, parameters.read(self._node, self._class.Settings), rng)

    def read_settings(self) -> None:
        """Take the learner's settings as the node's parameters have them now."""
        self.core.settings = parameters.read(self._node, self._class.Settings)

    # ------------------------------------------------------------ its life

    def begin(self) -> None:
        """Learn what was noted since the checkpoint, and act, or wait for a demonstration."""
        core = self.core
        if self._saving.wanted and self._alone:
            self._loop.note = self._note
            again = self._go_through()
            if self._again:
                return  # it was interrupted: nothing begins, and what was noted stays as it is
            self._saving.keep_journal(core.task.n_dims)
            if again or not self._fresh:
                self._offer()
        self._reports.weights()
        if self._ready:
            self.act_if_ready()
        else:
            topic = self._node.resolve_topic_name("sample")
            self._log.info(f"{core.task.name}: waiting for a demonstration on {topic}")

    def act_if_ready(self) -> None:
        """Act, when enough was learned for that and nobody forbids it."""
        if self._closing or self._computing.pretraining or not self._ready or not self._may_act():
            return
        if not (self.core.step or self.core.n_samples):
            self._saving.begin_journal()
        self._loop.start()
        self._log.info(f"acting on {self._node.resolve_topic_name('action')}")

    def stop(self) -> None:
        """Stop acting; what was learned stays."""
        self._loop.stop()

    def end(self) -> bool:
        """Save what is known, unless that is nothing; whether it was saved.

        What is being computed is waited for a moment, and otherwise left out.
        """
        self._closing = True
        self._computing.stop()
        if self._again or not self._saving.wanted:
            return False
        found = self._last_words()
        if not (self.core.step or self.core.n_samples or len(self._demonstrations)):
            return False
        say(f"learner: {self._saving.keeper().save(found)}")  # to be read at any log level
        return True

    def close(self) -> None:
        """Hear and say nothing more."""
        self._loop.close()
        self._reports.close()
        self._help.close()
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    @property
    def _log(self) -> Any:
        return self._node.get_logger()

    # ------------------------------------------------------------ in the control loop

    def respond(self, observation: Observation) -> tuple[int, Source] | None:
        """Answer a vehicle in this process; None while it does not act."""
        return self._loop.respond(observation)

    def transition(self, before: Observation, transition: Transition) -> None:
        """Learn from a step."""
        if not self.enabled:
            return
        due = self.core.observe(transition)
        if self._computing.updating:
            self._computing.since.append(transition)
        elif due:
            self._update()

    @property
    def busy(self) -> bool:
        """Whether an update must end before anything is answered."""
        if self._due:
            self._due = False
            self._update()
        if not self._computing.updating:
            return False
        if not self._loop.all_wait and not self.settings.background:
            self._log.warning(
                "the vehicle does not wait while an update is computed: it is flown with the "
                "policy before; set background:=true to have that from the first update on",
                once=True,
            )
        return self._waited_for

    @property
    def _waited_for(self) -> bool:
        """Whether the vehicle stands still until an update has ended."""
        return self._loop.all_wait and not self.settings.background

    def choose(self, observation: Observation) -> tuple[int, Source]:
        """Act on what was learned so far."""
        if self._computing.updating and self._computing.over():
            self._take_computed()
        return self.core.act(observation.state, explore=self.enabled)

    def answered(self, observation: Observation, source: Source, answer: Any) -> None:
        """Count the reward, and whether the answer explored; save now and then."""
        self._reports.answered(observation, source)
        self._help.answered(observation, source)
        if self._again:
            return
        if not self._computing.updating and self._saving.due():
            self._offer()

    def _update(self) -> None:
        """Compute beside this thread, and wait for a moment when the vehicle waits, too."""
        if self._computing.updating:
            return
        self._computing.update(self._snapshot(due=True))
        while self._again and not self._computing.over(MOMENT):
            runtime.check()
        if self._again or (self._waited_for and self._computing.over(MOMENT)):
            self._take_computed()

    # ------------------------------------------------------------ what is computed

    def look_after(self) -> None:
        """What no message brings about: the end of a demonstration and of learning from it."""
        computing = self._computing
        if computing.under_way and computing.over():
            updated = computing.updating
            self._take_computed()
            if updated:
                self._loop.go_on()
        elif (
            self._may_act() and not self._loop.running and not computing.under_way
            and self._demonstrations.complete()
        ):  # fmt: skip
            try:
                self._pretrain()
            except InputError as error:
                self._log.error(str(error))

    def learn_offline(self) -> str:
        """Begin to learn from all that was demonstrated; from what, in words.

        Raises
        ------
        InputError
            When that is nothing, or something is being computed.
        """
        self._settle()
        return self._pretrain()

    def _pretrain(self) -> str:
        transitions = self._demonstrations.transitions()
        if not len(transitions):
            self._demonstrations.forget_end()
            raise InputError(
                "the demonstration brought no sample; waiting for another: start a demonstrator"
            )
        text = f"{len(transitions)} demonstrated samples"
        if lost := self._demonstrations.missing():
            text += f", {lost} were lost on the way"
        self._loop.stop()
        self._log.info(f"learning offline from {text}")
        self._computing.pretrain(self._snapshot(), transitions)
        return text

    def _settle(self) -> None:
        """Take what was computed, so that no other thread is at work on the learner."""
        if self._computing.pretraining:
            raise InputError("it is learning from demonstrations; allowed: when that has ended")
        if not self._computing.over(MOMENT):
            raise InputError("an update is being computed; allowed: when that has ended")
        self._take_computed()

    def _take_computed(self) -> None:
        """Take what was computed, if anything was."""
        computing = self._computing
        if computing.pretraining:
            self._take_pretrained()
        elif computing.updating:
            try:
                self._publish_update(computing.take())
            except Exception as error:  # of whatever learner, for whatever numbers
                self._log.error(f"update failed, the policy before it stays: {error!r}")
            self._saving.updated()

    def _take_pretrained(self) -> None:
        self._demonstrations.forget_end()
        try:
            result = self._computing.take()
        except Exception as error:  # of whatever learner, for whatever numbers
            text = str(error) if isinstance(error, InputError) else repr(error)
            self._log.error(f"{text}; waiting for another demonstration")
            return
        self._publish_update(result)
        self._help.known(self._demonstrations.transitions())
        self._ready = True
        if self._closing:
            return
        self._log.info(result.text)
        self.act_if_ready()
        if self._saving.wanted:
            self._offer()

    def _publish_update(self, update: Update) -> None:
        self._reports.update(update)
        self._reports.weights()
        if not update.healthy:
            self._log.warning(update.text)

    # ------------------------------------------------------------ demonstrations

    def _on_sample(self, message: Any) -> None:
        if self._loop.running:
            if not self._while_flying:
                self._log.warning("samples of a demonstration come while flying")
            self._while_flying += 1
        try:
            self._demonstrations.add(message)
        except InputError as error:
            self._loop.ignore(str(error))

    def _on_demonstration(self, message: Any) -> None:
        try:
            self._demonstrations.announce(message)
        except InputError as error:
            self._loop.ignore(str(error))

    # ------------------------------------------------------------ what is kept of it

    def save(self) -> str:
        """Write a checkpoint now; where it is, in words.

        Raises
        ------
        InputError
            When nothing can be saved there, or something is being computed.
        """
        self._settle()
        return self._saving.save(self._snapshot(), self._mark())

    def load(self) -> str:
        """Take what is in the checkpoint, and act; where it is, in words.

        Raises
        ------
        InputError
            When there is none of this learner, or something is being computed.
        """
        self._settle()
        core, keeper = self.core, self._saving.keeper()
        path, content = keeper.path, checkpoint.read(keeper.path)
        checkpoint.restore(content, core, self.settings.learner, f"checkpoint {path}")
        keeper.go_on_from(path, content)
        self._reports.weights()
        self._ready = True
        self.act_if_ready()
        flight = checkpoint.part(content, "flight", Flight, f"checkpoint {path}")
        if flight is not None:
            self._saving.go_back(Mark(core.step, flight.loop.episode, flight.loop.step))
        return f"loaded {path}"

    def _resume(self, path: Path, content: checkpoint.Content) -> None:
        """Go on from a checkpoint, the vehicle in this process too."""
        where, core = f"checkpoint {path}", self.core
        checkpoint.restore(content, core, self.settings.learner, where)
        flight = checkpoint.part(content, "flight", Flight, where)
        self._ready = flight.ready if flight is not None else core.n_samples > 0
        self._help.recall(checkpoint.part(content, "help", Visits, where))
        if flight is not None:
            self._loop.recall(flight.loop)
            self._reports.recall(flight.sums)
            self._due = flight.due
        if self._vehicle is not None:
            memory = checkpoint.part(content, "vehicle", self._vehicle.Memory, where)
            if memory is not None:
                self._vehicle.recall(memory)
        self._saving.keeper().go_on_from(path, content)
        self._log.info(f"resumed from {path} at step {core.step}")

    def _go_through(self) -> bool:
        """Learn anew what a learner that was killed had learned since; whether there was any."""
        if not self._saving.settings.resume:
            return False
        n_dims = self.core.task.n_dims
        since = self._saving.observed_since(self._mark(), n_dims, fresh=self._fresh)
        self._again = self._reports.silent = self._help.silent = True
        try:
            for observation in since:
                runtime.check()
                self._loop.answer_again(observation)
        except KeyboardInterrupt:
            return False  # and `_again` stays: what is known now is on disk, and more
        self._again = self._reports.silent = self._help.silent = False
        if since:
            self._log.info(
                f"learned anew from {len(since)} observations noted since; now at step "
                f"{self.core.step}"
            )
        return bool(since)

    def _note(self, observation: Observation) -> None:
        """Write down what is learned from."""
        if self.enabled:
            self._saving.note(observation)

    def _offer(self) -> None:
        self._saving.offer(self._snapshot(), self._mark())

    def _mark(self) -> Mark:
        """Where the learner is, for a checkpoint of now."""
        return Mark(self.core.step, *self._loop.newest)

    def _snapshot(self, *, due: bool = False) -> Snapshot:
        """What is known now; taken in the control thread, which it hardly delays."""
        vehicle = self._vehicle.memory() if self._vehicle is not None else None
        return checkpoint.snapshot(
            self.core, self.settings.learner, self._saving.run, flight=self._flight(due=due),
            vehicle=vehicle, help=self._help.memory(),
        )  # fmt: skip

    def _flight(self, *, due: bool) -> Flight:
        return Flight(self._loop.memory(), self._reports.memory(), due, self._ready)

    def _last_words(self) -> Snapshot:
        """What to save at the end; never what was half done."""
        if not self._computing.over(PATIENCE) or self._computing.cut:
            return self._before_and_since()
        self._take_computed()
        return self._snapshot()

    def _before_and_since(self) -> Snapshot:
        """What was known before a computation, and what was observed while it ran."""
        before, since = self._computing.before, self._computing.since
        assert before is not None
        if not since:
            return before
        core = self._make(self.core.task, np.random.default_rng())
        checkpoint.restore(before(), core, self.settings.learner, "this learner")
        for transition in since:
            core.observe(transition)
        flight = self._flight(due=True)
        return checkpoint.snapshot(core, self.settings.learner, self._saving.run, flight=flight)

    # ------------------------------------------------------------ how it is

    def phase(self) -> str:
        """What it does, in a word or two."""
        if self._computing.pretraining:
            return "learning offline"
        if not self._loop.running:
            waits = self._node.active and not self._ready
            return "waiting for a demonstration" if waits else "inactive"
        return "learning" if self.enabled else "acting"

    def describe(self, report: Report) -> None:
        """Add how it goes, and what is wrong, to a report."""
        report.values |= {
            "task": self.core.task.name,
            "demonstrated samples": len(self._demonstrations),
            "samples that came while flying": self._while_flying,
        }
        for part in (self._loop, self._reports):
            condition, worry = part.condition()
            report.values |= condition
            report.worry(worry)
        report.worry(self._help.reason)
        if self._while_flying:
            report.worry(
                f"{self._while_flying} samples came while flying; they are learned from with "
                "~/learn_offline alone"
            )
