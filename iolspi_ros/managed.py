"""What our managed nodes share: a life of transitions, which start by themselves if wanted."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from iolspi_ros import parameters, runtime
from iolspi_ros.arguments import for_node
from iolspi_ros.arguments import given as given_parameters
from iolspi_ros.errors import InputError
from iolspi_ros.settings import Settings, setting


@dataclass(frozen=True)
class Autostart(Settings):
    """Whether a managed node waits for somebody to manage it."""

    autostart: str = setting(
        "activate", "transitions that the node makes at once, without being told to",
        choices=("never", "configure", "activate"),
    )  # fmt: skip


class ManagedNode(LifecycleNode):
    """A lifecycle node whose transitions may refuse with an `InputError`.

    A refused transition leaves it where it was, and says why. When it was to start by itself that
    ends it: see `failure`. Subclasses define `configure`, `activate`, `deactivate`, `cleanup` and
    `close`, the last of which puts away what must not be lost, whatever the state.

    Parameters
    ----------
    name : str
    arguments : sequence of str, optional
        `--ros-args …` of this node alone; those of the process by default.

    Attributes
    ----------
    failure : InputError, optional
        Why the node cannot go on; whoever spins it ends it with that.
    active : bool
    given : dict
        Parameters that its arguments give it, by name.
    """

    Autostart: type[Autostart] = Autostart

    def __init__(self, name: str, arguments: Sequence[str] | None = None) -> None:
        given = sys.argv if arguments is None else arguments
        with for_node(given, name) as adapted:
            super().__init__(name, cli_args=adapted, use_global_arguments=False)
            self.given = given_parameters(adapted, name)
        self.failure: InputError | None = None
        self.active = False
        self._refused: InputError | None = None
        self._starting = False
        wanted = parameters.declare(self, self.Autostart).autostart
        if wanted != "never":
            self._autostart = runtime.wall_timer(self, 0.0, lambda: self._start(wanted))
        else:
            self._say_next("configure")

    def fail(self, error: InputError) -> None:
        """Let whoever spins this node end it."""
        self.failure = self.failure or error

    def _start(self, wanted: str) -> None:
        self._autostart.cancel()
        self._starting = True
        done = TransitionCallbackReturn.SUCCESS
        if self.trigger_configure() is done and (
            wanted == "configure" or self.trigger_activate() is done
        ):
            self._starting = False
            if wanted == "configure":
                self._say_next("activate")
            return
        self.fail(self._refused or InputError(f"{self.get_name()} could not start by itself"))

    def _say_next(self, transition: str) -> None:
        """Say what a person must do for it to go on."""
        name = self.get_fully_qualified_name().removeprefix("/")
        self.get_logger().info(
            f"waiting for somebody to {transition} it: iolspi manage {name} {transition} (or start "
            "it with -p autostart:=activate)"
        )

    # ------------------------------------------------------------ for subclasses

    def configure(self) -> None:
        """Get ready; what is published and listened to begins here."""
        raise NotImplementedError

    def activate(self) -> None:
        """Begin to act."""
        raise NotImplementedError

    def deactivate(self) -> None:
        """Stop acting."""
        raise NotImplementedError

    def cleanup(self) -> None:
        """Undo `configure`."""
        raise NotImplementedError

    def close(self) -> None:
        """Put away what must not be lost."""
        raise NotImplementedError

    # ------------------------------------------------------------ transitions

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Get ready."""
        return self._attempt(self.configure, self.active)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to act."""
        return self._attempt(self.activate, True)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop acting."""
        return self._attempt(self.deactivate, False)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Undo `on_configure`."""
        return self._attempt(self.cleanup, False)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Put away what must not be lost."""
        return self._attempt(self.close, False)

    def _attempt(self, act: Callable[[], None], active: bool) -> TransitionCallbackReturn:
        before = self.active
        try:
            self.active = active
            act()
        except InputError as error:
            self.active, self._refused = before, error
            if not self._starting:  # otherwise whoever spins it says so
                self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS
