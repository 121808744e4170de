"""A person takes the vehicle over when no demonstration is under way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from iolspi_ros import runtime
from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Observation, Transition
from iolspi_ros.nodes.control_loop import ControlLoop
from iolspi_ros.nodes.joystick import Joystick
from iolspi_ros.nodes.pilot_topics import PilotTopics
from iolspi_ros.nodes.samples_out import SamplesOut
from iolspi_ros.settings import Settings, setting
from iolspi_ros.wire import Phase


@dataclass(frozen=True)
class TakeoverSettings(Settings):
    """How a person takes over when no demonstration is under way."""

    takeover_button: int = setting(
        -1, "button of the joystick that gives the vehicle to the person; -1 for none", low=-1
    )
    takeover_latched: bool = setting(
        False, "press once to take over and once more to give back, instead of holding"
    )


class Override:
    """While a button says so, a person has the vehicle: the stick answers each observation.

    Parameters
    ----------
    node : SamplesOut
    settings : TakeoverSettings
    stick : Joystick
    topics : PilotTopics
    """

    def __init__(
        self, node: SamplesOut, settings: TakeoverSettings, stick: Joystick, topics: PilotTopics
    ) -> None:
        self._node, self._settings = node, settings
        self._stick, self._topics = stick, topics
        self._pressed = stick.pressed(settings.takeover_button)
        self._loop = ControlLoop(node, node.task, self, 0.0)
        self._timer = runtime.wall_timer(node, runtime.LOOK, self.look)
        self._say(held=False)
        node.get_logger().info(f"button {settings.takeover_button} takes the vehicle over")

    def resume(self) -> None:
        """Watch the button."""
        self._loop.start()

    def pause(self) -> None:
        """Give the vehicle back."""
        self._loop.stop()
        self._say(held=False)

    def put_away(self) -> None:
        """Nothing is recorded."""

    def close(self) -> None:
        """Stop for good."""
        self._loop.close()
        self._node.destroy_timer(self._timer)

    def look(self) -> None:
        """Take the vehicle or give it back, as the button says; a silent stick holds nothing."""
        if not self._loop.running:
            return
        pressed, before = self._stick.pressed(self._settings.takeover_button), self._pressed
        self._pressed, held = pressed, pressed
        if self._settings.takeover_latched:
            held = self._topics.held != (pressed and not before) and not self._stick.silent
        if held != self._topics.held:
            self._node.get_logger().info("taken over" if held else "given back")
            self._say(held=held)
        if held:
            self._loop.go_on()

    def _say(self, *, held: bool) -> None:
        self._topics.say(Phase.ENDED, held=held, seen=self._loop.seen)

    @property
    def busy(self) -> bool:
        """Whether somebody else flies."""
        return not self._topics.held or self._stick.silent

    def choose(self, observation: Observation) -> tuple[int, Source]:
        """What the person does."""
        return self._stick.action(), Source.HUMAN

    def answered(self, observation: Observation, source: Source, answer: Any) -> None:
        """The learner learns from what the vehicle says."""

    def transition(self, before: Observation, transition: Transition) -> None:
        """As above."""
