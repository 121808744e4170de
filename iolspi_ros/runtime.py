"""How every node of ours starts, spins and ends."""

from __future__ import annotations

import contextlib
import gc
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle, NotInitializedException
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions
from rclpy.timer import Timer

from iolspi_ros import environment
from iolspi_ros.arguments import without_files
from iolspi_ros.beside import computing
from iolspi_ros.errors import InputError

ENDS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
"""Signals that ask a process of ours to save and end."""
GLANCE, MOST_EVENTS = 0.002, 50
"""Seconds without an event after which nodes in one process go on stepping; events at most."""
RCLError: type[Exception] = rclpy_implementation.RCLError


def executor(context: Context | None = None) -> Executor:
    """The fastest executor that this rclpy has; of the default context, or another."""
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:  # rclpy of the first Jazzy releases
        from rclpy.executors import SingleThreadedExecutor

        return SingleThreadedExecutor(context=context)
    return EventsExecutor(context=context)


def wall_timer(node: Node, period: float, callback: Callable[[], object]) -> Timer:
    """A timer on the machine's steady clock, whatever the graph's clock does; period in s."""
    return node.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


def publish(publisher: Publisher, message: Any) -> None:
    """Publish, unless a signal has just ended the context."""
    try:
        publisher.publish(message)
    except RCLError:
        if rclpy.ok():
            raise


class Nodes(Protocol):
    """Nodes that live in one process.

    Attributes
    ----------
    nodes : sequence of rclpy.node.Node
        Each with a method `close`.
    """

    nodes: Sequence[Node]

    def pump(self) -> bool:
        """Do what no event brings about; False when there was nothing."""
        ...


def main(
    make: Callable[[Sequence[str]], Node | Nodes],
    name: str,
    arguments: Sequence[str] | None = None,
    *,
    last_word: bool = False,
) -> int:
    """Run one node, or some in one process, until told to stop.

    Parameters
    ----------
    make : callable
        Makes the node from the arguments; it has a method `close`.
    name : str
        For messages.
    arguments : sequence of str, optional
        Command line with `--ros-args`; that of the process by default.
    last_word : bool
        After a signal the node can still publish while it is closed; else the context is down.

    Returns
    -------
    int
        Exit status: 0 after SIGINT, SIGTERM, SIGHUP or SIGQUIT, 2 for bad input, 1 when something
        could not be put away where it belongs.
    """
    made: list[Node | Nodes] = []
    begun, making, told = False, True, False
    handlers = SignalHandlerOptions.NO if last_word else None

    def interrupt(*_: object) -> None:
        # rclpy's own handler, which calls this one, shuts the context down and so ends the
        # loop; an exception from here would land anywhere, also in the executor's C++.
        nonlocal making, told
        told = True
        if making:
            making = False  # a second signal must not interrupt how the first one is handled
            raise KeyboardInterrupt

    handle_ends(interrupt)
    status = 0
    try:
        environment.check()
        given = sys.argv if arguments is None else arguments
        rclpy.init(args=without_files(given), signal_handler_options=handlers)
        begun = True
        made.append(make(given))
        making = False
        spin(made[0], lambda: told and last_word)
    except KeyboardInterrupt:
        pass
    except InputError as error:
        print(f"{name}: {error}", file=sys.stderr)
        status = 2
    except (RCLError, NotInitializedException, InvalidHandle) as error:
        if not begun or rclpy.ok():  # otherwise a signal came while the node was being made
            # A parameter that is no YAML.
            print(f"{name}: {_first_line(error)}", file=sys.stderr)
            status = 2
    except Exception:
        if not begun or rclpy.ok():  # otherwise what was being made missed its context
            raise
    finally:
        making = False
        # A second Ctrl-C, or the one sent to the whole process group, must not cut the saving.
        for number in ENDS:
            signal.signal(number, signal.SIG_IGN)
        for node in (node for one in made for node in _nodes(one)):
            status = max(status, _put_away(node, name))
        with contextlib.suppress(RCLError):  # rclpy's handler of a late signal was first
            rclpy.try_shutdown()
    if computing():  # nobody waits for that any more, and an orderly end would
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    return status


def handle_ends(interrupt: Callable[..., None]) -> None:
    """Let every signal that asks for an end do what SIGINT and SIGTERM do.

    rclpy has handlers for those two alone, which wake its executors; the others are passed on as
    SIGTERM. A signal that is ignored from the start, as SIGHUP is below nohup, stays so.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, interrupt)
    for number in (signal.SIGHUP, signal.SIGQUIT):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda *_: signal.raise_signal(signal.SIGTERM))


def _nodes(made: Node | Nodes) -> Sequence[Node]:
    return [made] if isinstance(made, Node) else made.nodes


def spin(made: Node | Nodes, told: Callable[[], bool] = lambda: False) -> None:
    """Handle events until the context is shut down, or `told` to end.

    Raises
    ------
    InputError
        Why a managed node cannot go on.
    """
    loop, nodes = executor(), _nodes(made)
    pump = None if isinstance(made, Node) else made.pump
    for node in nodes:
        loop.add_node(node)
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000)  # little here makes cycles; looking for them costs the loop
    context = nodes[0].context
    try:
        while context.ok() and not told():
            busy = pump is not None and pump()
            if busy:
                _look_in(loop, nodes)
            else:
                _spin_once(loop, nodes, 0.25)
            for node in nodes:
                if (failure := getattr(node, "failure", None)) is not None:
                    raise failure
    except ExternalShutdownException:
        pass


def _look_in(loop: Executor, nodes: Sequence[Node]) -> None:
    """Handle the events that wait; each spin handles one, and none takes its whole time."""
    for _ in range(MOST_EVENTS):
        begin = time.monotonic()
        _spin_once(loop, nodes, GLANCE)
        if time.monotonic() - begin >= 0.9 * GLANCE:
            return


def _spin_once(loop: Executor, nodes: Sequence[Node], timeout: float) -> None:
    try:
        loop.spin_once(timeout_sec=timeout)
    except RCLError as error:
        if not rclpy.ok():  # a signal came while a callback was publishing
            return
        if not isinstance(nodes[0], LifecycleNode):
            raise
        # Asked for a transition that its state does not have; rclpy would end the node for that.
        nodes[0].get_logger().warning(f"refused: {_first_line(error)}")


def _put_away(node: Node, name: str) -> int:
    """Close a node; 1 when something of it could not be put away, and was said."""
    status = 0
    try:
        node.close()
    except InputError as error:
        print(f"{name}: {error}", file=sys.stderr)
        status = 1
    with contextlib.suppress(RCLError):
        node.destroy_node()
    return status


def _first_line(error: Exception) -> str:
    text = str(error)
    return text.split(", at ")[0].splitlines()[0]
