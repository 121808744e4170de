"""How every node of ours starts, spins and ends."""

from __future__ import annotations

import contextlib
import gc
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.timer import Timer

from iolspi_ros import environment
from iolspi_ros.arguments import without_files
from iolspi_ros.beside import computing
from iolspi_ros.errors import InputError
from iolspi_ros.process import say

ENDS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
"""Signals that ask a process of ours to save and end."""
LOOK = 0.05
"""Seconds between two looks at what no message brings about: silence, time, a signal."""
CATCH_UP, MOST_MESSAGES = 0.25, 100
"""Seconds between two looks for what nobody announced; of one topic or service at most."""
LAST_WORD = 1.0
"""Seconds at most until what was published last has to be heard, before a publisher goes."""
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


class Loop:
    """Handles the events of nodes, also of messages, requests and answers that came without one.

    When an executor begins to listen, rmw_fastrtps counts what waits and after that asks for
    events. Of a message between the two nobody ever hears, and as each event takes one message
    all later ones are taken one too late, for ever.

    Parameters
    ----------
    nodes : rclpy.node.Node
    context : rclpy.context.Context, optional
        Theirs; the default one.
    """

    def __init__(self, *nodes: Node, context: Context | None = None) -> None:
        self._executor, self._nodes, self._due = executor(context), nodes, 0.0
        for node in nodes:
            self._executor.add_node(node)

    def once(self, timeout: float) -> None:
        """Handle one event, or wait so many seconds for it."""
        if time.monotonic() >= self._due:
            self._due = time.monotonic() + CATCH_UP
            self._catch_up()
        self._executor.spin_once(timeout_sec=timeout)

    def close(self) -> None:
        """Let the nodes go; before they are destroyed, or an event may find one gone."""
        self._executor.shutdown()

    def _catch_up(self) -> None:
        for node in self._nodes:
            for entities, take in (
                (node.subscriptions, _take_message),
                (node.services, _take_request),
                (node.clients, _take_response),
            ):
                for entity in list(entities):
                    with contextlib.suppress(InvalidHandle):
                        for _ in range(MOST_MESSAGES):
                            if not take(entity):
                                break


def _take_message(subscription: Any) -> bool:
    """Handle a message that waits, if there is one."""
    handle = subscription.handle
    with handle:
        taken = handle.take_message(subscription.msg_type, subscription.raw)
    if taken is not None:
        subscription.callback(taken[0])
    return taken is not None


def _take_request(service: Any) -> bool:
    """Answer a request that waits, if there is one."""
    handle = service.handle
    with handle:
        request, header = handle.service_take_request(service.srv_type.Request)
    if header is not None:
        response = service.callback(request, service.srv_type.Response())
        service.send_response(response, header)
    return header is not None


def _take_response(client: Any) -> bool:
    """Hand on an answer that waits, if there is one."""
    handle = client.handle
    with handle:
        header, response = handle.take_response(client.srv_type.Response)
    if header is not None:
        with contextlib.suppress(KeyError):  # nobody waits for it any more
            client.get_pending_request(header.request_id.sequence_number).set_result(response)
    return header is not None


def wall_timer(node: Node, period: float, callback: Callable[[], object]) -> Timer:
    """A timer on the machine's steady clock, whatever the graph's clock does; period in s."""
    return node.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


class _Patience:
    """Seconds that may be waited for last words; comes back as time passes."""

    left, when = 0.0, 0.0


def destroy_publishers(node: Node, *publishers: Any) -> None:
    """Destroy publishers, once whoever listens has what they said.

    What is published just before a publisher goes, or its process ends, is else lost to a reader
    that is a little late: an episode's end, a vehicle given back, a stick centred.

    Parameters
    ----------
    node : rclpy.node.Node
        Theirs.
    publishers : rclpy.publisher.Publisher
        For readers that do not answer (theirs may have been killed) `LAST_WORD` seconds are
        waited, once for all that go at about the same time.
    """
    for publisher in publishers:
        begin = time.monotonic()
        left = min(LAST_WORD, _Patience.left + begin - _Patience.when)
        with contextlib.suppress(RCLError, InvalidHandle):
            publisher.wait_for_all_acked(Duration(seconds=left))
        _Patience.when = time.monotonic()
        _Patience.left = max(0.0, left - (_Patience.when - begin))
        node.destroy_publisher(publisher)


class _Asked:
    """Whether a signal has asked this process to end."""

    told = False


def ok() -> bool:
    """Whether the graph is there, and no signal has asked this process to end.

    A signal shuts no context down: an executor that is just taking in its entities would not
    survive that, and who is ended can still say its last word.
    """
    return not _Asked.told and rclpy.ok()


def check() -> None:
    """Raise KeyboardInterrupt unless `ok`; for commands, between two looks at the graph."""
    if not ok():
        raise KeyboardInterrupt


@contextmanager
def session(
    arguments: Sequence[str] | None = None, interrupt: Callable[[], None] = lambda: None
) -> Iterator[None]:
    """Be in a graph; of the signals that ask for an end the first makes `ok` false.

    Parameters
    ----------
    arguments : sequence of str, optional
        Command line with `--ros-args`; that of the process by default.
    interrupt : callable
        Called besides, in the main thread, at each of them.
    """

    def ask(*_: object) -> None:
        _Asked.told = True
        interrupt()

    _Asked.told, before = False, {number: signal.getsignal(number) for number in ENDS}
    for number in ENDS:
        ignored = signal.getsignal(number) is signal.SIG_IGN
        if number in (signal.SIGINT, signal.SIGTERM) or not ignored:  # as SIGHUP is below nohup
            signal.signal(number, ask)
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield
    finally:
        rclpy.try_shutdown()
        for number in ENDS:
            if signal.getsignal(number) is ask:
                signal.signal(number, before[number])


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
) -> int:
    """Run one node, or some in one process, until told to stop.

    Parameters
    ----------
    make : callable
        Makes the node from the arguments; it has a method `close`, in which it can still publish.
    name : str
        For messages.
    arguments : sequence of str, optional
        Command line with `--ros-args`; that of the process by default.

    Returns
    -------
    int
        Exit status: 0 after SIGINT, SIGTERM, SIGHUP or SIGQUIT, 2 for bad input, 1 when something
        could not be put away where it belongs.
    """
    made: list[Node | Nodes] = []
    making = True

    def interrupt() -> None:
        # Once it spins an exception from here would land anywhere, also in the executor's C++.
        nonlocal making
        if making:
            making = False  # a second signal must not interrupt how the first one is handled
            raise KeyboardInterrupt

    sys.unraisablehook = _unraisable
    status = 0
    try:
        environment.check()
        given = sys.argv if arguments is None else arguments
        with session(without_files(given), interrupt):
            try:
                made.append(make(given))
                making = False
                spin(made[0])
            finally:
                making = False
                # A second Ctrl-C, or that for the whole process group, must not cut the saving.
                for number in ENDS:
                    signal.signal(number, signal.SIG_IGN)
                for node in (node for one in made for node in _nodes(one)):
                    status = max(status, _put_away(node, name))
    except KeyboardInterrupt:
        pass
    except InputError as error:
        say(f"{name}: {error}")
        status = 2
    except RCLError as error:  # of a parameter that is no YAML
        say(f"{name}: {_first_line(error)}")
        status = 2
    if computing():  # nobody waits for that any more, and an orderly end would
        with contextlib.suppress(OSError):
            sys.stdout.flush()
        os._exit(status)
    return status


def _unraisable(found: Any) -> None:
    """Say nothing of an interrupt that came where nothing can be raised: `ok` tells of it, too."""
    if found.exc_type is not KeyboardInterrupt:
        sys.__unraisablehook__(found)


def _nodes(made: Node | Nodes) -> Sequence[Node]:
    return [made] if isinstance(made, Node) else made.nodes


def spin(made: Node | Nodes) -> None:
    """Handle events as long as `ok`.

    Raises
    ------
    InputError
        Why a managed node cannot go on.
    """
    nodes = _nodes(made)
    pump = None if isinstance(made, Node) else made.pump
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000)  # little here makes cycles; looking for them costs the loop
    with contextlib.closing(Loop(*nodes)) as loop, contextlib.suppress(ExternalShutdownException):
        while ok():
            busy = pump is not None and pump()
            if busy:
                _look_in(loop, nodes)
            else:
                _spin_once(loop, nodes, LOOK)
            for node in nodes:
                if (failure := getattr(node, "failure", None)) is not None:
                    raise failure


def _look_in(loop: Loop, nodes: Sequence[Node]) -> None:
    """Handle the events that wait; each spin handles one, and none takes its whole time."""
    for _ in range(MOST_EVENTS):
        begin = time.monotonic()
        _spin_once(loop, nodes, GLANCE)
        if time.monotonic() - begin >= 0.9 * GLANCE:
            return


def _spin_once(loop: Loop, nodes: Sequence[Node], timeout: float) -> None:
    try:
        loop.once(timeout)
    except RCLError as error:
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
        say(f"{name}: {error}")
        status = 1
    with contextlib.suppress(RCLError):
        destroy_publishers(node, *node.publishers)
        node.destroy_node()
    return status


def _first_line(error: Exception) -> str:
    text = str(error)
    return text.split(", at ")[0].splitlines()[0]
