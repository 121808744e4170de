"""A person at a joystick flies demonstrations; each episode is kept or not as a whole."""

from __future__ import annotations

import numpy as np

from iolspi_ros import runtime, wire
from iolspi_ros.bags import survey
from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Observation, Sample, Transitions
from iolspi_ros.nodes.coach import Coach
from iolspi_ros.nodes.joystick import Joystick
from iolspi_ros.nodes.pilot_topics import PilotTopics
from iolspi_ros.nodes.piloting import Flown, Piloting, PilotingSettings
from iolspi_ros.nodes.samples_out import SamplesOut
from iolspi_ros.nodes.teleop import Teleop, TeleopSettings
from iolspi_ros.wire import Phase


class HandFlight(Teleop):
    """A person flies; each episode is kept or not as a whole.

    Parameters
    ----------
    node : SamplesOut
    settings : TeleopSettings
    piloting : PilotingSettings
    stick : Joystick
    topics : PilotTopics
    """

    def __init__(
        self, node: SamplesOut, settings: TeleopSettings, piloting: PilotingSettings,
        stick: Joystick, topics: PilotTopics,
    ) -> None:  # fmt: skip
        rng = np.random.default_rng([settings.seed, 2])
        super().__init__(node, settings, rng, 0.0)  # nobody is waited for but the person
        self._stick, self._topics = stick, topics
        self.piloting = Piloting(piloting, settings.episodes, stick)
        self._coach = Coach(node, foresees=piloting.foresight) if piloting.review else None
        self._rows = wire.SampleRows(node.task.names)
        self._verdicts = wire.Rows("verdict", wire.VERDICT)
        self._flown: Flown | None = None
        self._timer = runtime.wall_timer(node, runtime.LOOK, self.look)
        topic = node.resolve_topic_name("joy")
        node.get_logger().info(f"waiting for a joystick on {topic}")

    # ------------------------------------------------------------ life

    def resume(self) -> None:
        """Fly when the stick moves."""
        if not self._over:
            self._loop.start()

    def pause(self) -> None:
        """Leave the vehicle alone; the episode under way is recorded, and not kept."""
        super().pause()
        if self._flown is not None:
            self._flown.marked = self._flown.marked or "the demonstrator was paused"
        self.put_away()
        self.piloting.interrupt()
        self._say()

    def put_away(self) -> None:
        """Record the episode under way; kept where nobody is to judge it."""
        flown, self._flown = self._flown, None
        if flown is not None:
            self._store(flown, kept=not (self.piloting.review or flown.marked))

    def close(self) -> None:
        """Stop for good."""
        super().close()
        self._node.destroy_timer(self._timer)
        if self._coach is not None:
            self._coach.close()

    def look(self) -> None:
        """Go on where stick or time say so, and answer what waited for that."""
        if self._loop.running and not self.busy:
            self._loop.go_on()
        if self._coach is not None:
            self._coach.look()

    # ------------------------------------------------------------ in the control loop

    @property
    def busy(self) -> bool:
        """Whether the vehicle waits for the person."""
        before = self.piloting.phase
        self.piloting.look()
        phase = self.piloting.phase
        if phase is not before:
            self._tell(phase)
        self._say()
        flies = phase in (Phase.FLYING, Phase.PAUSED)
        return not (flies or self._over or self.piloting.ready)

    def _tell(self, phase: Phase) -> None:
        log = self._node.get_logger()
        if phase is Phase.COUNTDOWN:
            log.info(f"the joystick is there; flying in {self.piloting.countdown:.0f} s")
        elif phase is Phase.PAUSED:
            log.warning("the joystick is silent; the rest of this episode is flown neutral")
            if self._flown is not None:
                self._flown.marked = "the joystick was silent"

    def _say(self) -> None:
        p = self.piloting
        self._topics.say(
            p.phase, held=p.holds and self._loop.running, episodes=(p.kept, p.discarded),
            countdown=p.countdown, seen=self._loop.seen,
        )  # fmt: skip

    def pilot(self, observation: Observation) -> tuple[int, Source]:
        """What the person does, once an episode has begun with them."""
        if self.piloting.ready and observation.step == 0:
            self.begin()
            self.piloting.begin()
            self._flown = Flown(observation.episode)
            self._say()
        elif self._flown is not None and observation.episode != self._flown.episode:
            self._land(whole=False)
        if self.piloting.phase is not Phase.FLYING:
            return self._node.task.neutral, Source.HOLD
        if self._flown is None:
            self._flown = Flown(observation.episode)
        return self._stick.action(), Source.HUMAN

    def write(self, episode: int, topic: str, kind: str, stamp: int, data: bytes) -> None:
        """Remember a message of the episode under way."""
        if self._flown is not None and episode == self._flown.episode:
            self._flown.records.append((topic, kind, stamp, data))

    def take(self, sample: Sample) -> None:
        """Remember a step of the episode under way."""
        if self._flown is not None and sample.episode == self._flown.episode:
            message = self._rows.of(sample)
            self._flown.records.append(("sample", wire.ROW, sample.stamp, message))
            self._flown.samples.append((sample, message))

    def landed(self, episode: int) -> None:
        """Keep the episode, or leave it to the person."""
        if self._flown is not None and episode == self._flown.episode:
            self._land()

    def _land(self, *, whole: bool = True) -> None:
        flown, self._flown = self._flown, None
        assert flown is not None
        kept = self.piloting.landed(flown, whole=whole)
        self._store(flown, kept=bool(kept))
        if kept:
            self._send(flown)
        p = self.piloting
        words = {None: "waits for a verdict", True: "kept", False: f"not kept: {flown.marked}"}[
            kept
        ]
        self._node.get_logger().info(
            f"episode {flown.episode} {words}; {p.kept} of {self._settings.episodes}"
        )
        self._over = p.phase is Phase.ENDED
        self._say()

    # ------------------------------------------------------------ what becomes of it

    def _store(self, flown: Flown, *, kept: bool) -> None:
        """Write an episode to the bag, and what is thought of it."""
        if not flown.samples:
            return
        for topic, kind, stamp, data in flown.records:
            self._node.record(topic, kind, stamp, data)
        flown.records.clear()
        self._rule(flown, kept=kept)

    def _rule(self, flown: Flown, *, kept: bool, before: bool = False) -> None:
        """Write a verdict to the bag."""
        step, stamp = flown.last
        values = (flown.episode, step, *wire.split(stamp), kept)
        self._node.record("verdict", wire.ROW, stamp, self._verdicts.pack(*values))
        self._node.recorded += (kept - before) * len(flown.samples)

    def _send(self, flown: Flown) -> None:
        for sample, message in flown.samples:
            self._node.queue(sample, message)

    def keep(self) -> str:
        """Keep the episode flown last; what was done, in words.

        Raises
        ------
        InputError
            When there is none to judge.
        """
        return self._judge(True)

    def discard(self) -> str:
        """Discard it; otherwise as `keep`."""
        return self._judge(False)

    def _judge(self, kept: bool) -> str:
        flown = self.piloting.judge(kept)
        self._rule(flown, kept=kept)
        self._say()
        done = "kept" if kept else "discarded"
        return f"episode {flown.episode} is {done}; {self._standing()}{self._extent()}"

    def undo(self) -> str:
        """Take the last verdict back; what was done, in words.

        Raises
        ------
        InputError
            When there is none.
        """
        flown, kept = self.piloting.undo()
        self._rule(flown, kept=False, before=kept)
        self._say()
        again = "waits for a verdict again"
        return f"episode {flown.episode} {again}; {self._standing()}{self._extent()}"

    def finish(self) -> str:
        """End the demonstration with what was kept; what was done, in words.

        Raises
        ------
        InputError
            When that is nothing.
        """
        kept = self.piloting.finish()
        self.put_away()
        for flown in kept:
            self._send(flown)
        self._over = True
        self._say()
        text = self._standing()
        self._loop.stop()
        self._node.end()
        return text

    def _extent(self) -> str:
        """What the episodes that are kept cover; the coach hears of them, too."""
        kept = [flown for flown, kept in self.piloting.judged if kept]
        if self._coach is not None:
            self._coach.kept(kept)
        task = self._node.task
        samples = [sample.transition for flown in kept for sample, _ in flown.samples]
        batch = Transitions.of(samples, task.n_dims)
        return f"; {survey.extent(batch, task)}" if samples else ""

    def _standing(self) -> str:
        p = self.piloting
        open_ones = f", {len(p.undecided)} not decided" if p.undecided else ""
        return f"{p.kept} kept, {p.discarded} discarded{open_ones}"
