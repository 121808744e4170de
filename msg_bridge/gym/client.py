"""Who acts, as a plain object: waits for an observation, answers it, waits for the next."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Any

import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from iolspi_ros import qos, runtime, wire
from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Observation
from iolspi_ros.errors import InputError
from iolspi_ros.pairing import Pairer
from iolspi_ros.task import TaskDescription
from iolspi_ros.vehicle_topics import TaskListener

VEHICLES = ("simulator", "vehicle", "bridge")
"""Nodes whose service `reset` begins anew."""
HEARD = 1.0
"""Seconds in which a vehicle that waits for an answer repeats its state many times."""


class GraphClient:
    """Acts in a graph, in a context of its own.

    Parameters
    ----------
    domain : int
        ROS domain.
    namespace : str
    timeout : float
        Seconds that anything may take.
    alive : callable
        Raises when waiting has no sense any more.
    """

    def __init__(
        self, domain: int, namespace: str, timeout: float, alive: Callable[[], None]
    ) -> None:
        self._timeout, self._alive = timeout, alive
        self._context = Context()
        rclpy.init(
            args=[], context=self._context, domain_id=domain,
            signal_handler_options=SignalHandlerOptions.NO,
        )  # fmt: skip
        self._node = Node(
            "gymnasium", context=self._context, namespace=namespace or None,
            use_global_arguments=False, enable_rosout=False,
        )  # fmt: skip
        self._loop = runtime.Loop(self._node, context=self._context)
        self._conflict = ""
        self._seen: deque[Observation] = deque()
        self._newest = (-1, -1)
        self._answered: tuple[tuple[int, int], bytes] = ((-1, -1), b"")
        self._listener = TaskListener(self._node, lambda task: None, self._on_conflict)
        where = f"a vehicle on {self._listener.topic}"
        self._wait(lambda: self._listener.task is not None, where)
        assert self._listener.task is not None
        self.task: TaskDescription = self._listener.task
        self._connect()

    def _connect(self) -> None:
        self._pairer = Pairer(self.task)
        self._rows = wire.Rows("action", wire.ACTION)
        self._out = self._node.create_publisher(Float64MultiArray, "action", qos.OUTGOING)
        for kind, topic, pair in (
            (wire.states(self.task).type, "state", self._pairer.state),
            (Float64MultiArray, "reward", self._pairer.reward),
        ):
            self._node.create_subscription(kind, topic, self._receiver(pair), qos.CONTROL, raw=True)
        self._wait(lambda: self._out.get_subscription_count() > 0, "somebody who takes actions")

    def _receiver(self, pair: Callable[[Any], Observation | None]) -> Callable[[Any], None]:
        def receive(message: Any) -> None:
            try:
                observation = pair(message)
            except InputError as error:
                self._node.get_logger().warning(str(error), throttle_duration_sec=5.0)
                return
            if observation is not None:
                self._take(observation)

        return receive

    def _take(self, observation: Observation) -> None:
        key, (answered, answer) = (observation.episode, observation.step), self._answered
        if key > self._newest:
            self._newest = key
            self._seen.append(observation)
        elif key == answered:  # it is repeated: the answer was lost, or is late
            self._out.publish(answer)

    def _on_conflict(self, text: str) -> None:
        self._conflict = text

    # ------------------------------------------------------------ what acts calls these

    def answer(self, observation: Observation, action: int, source: Source) -> None:
        """Publish an action for an observation."""
        key = (observation.episode, observation.step)
        packed = self._rows.pack(*key, *wire.split(observation.stamp), action, source)
        self._answered = (key, packed)
        self._out.publish(packed)

    def following(self, observation: Observation) -> list[Observation]:
        """What came after an observation: one in lockstep, perhaps more in real time."""
        key = (observation.episode, observation.step)
        self._drop(lambda seen: (seen.episode, seen.step) <= key)
        self._wait(lambda: bool(self._seen), "the vehicle's next state")
        found = list(self._seen)
        self._seen.clear()
        return found

    def restart(self, seed: int | None) -> Observation | None:
        """Begin anew with a seed; None when the vehicle has no such service."""
        vehicle = self._vehicle()
        if vehicle is None:
            return None
        self._spin(lambda: self._newest[0] >= 0, HEARD)  # else an old episode would look new
        before = self._newest[0]
        if seed is not None:
            wanted = Parameter("seed", value=seed).to_parameter_msg()
            request = SetParameters.Request(parameters=[wanted])
            result = self._call(SetParameters, f"{vehicle}/set_parameters", request).results[0]
            if not result.successful:
                raise InputError(f"seed is {seed}: {result.reason}")
        answer = self._call(Trigger, f"{vehicle}/reset", Trigger.Request())
        if not answer.success:
            raise InputError(f"{vehicle} cannot begin anew: {answer.message}")

        def begun() -> bool:
            self._drop(lambda seen: seen.episode <= before or seen.step > 0)
            return bool(self._seen)

        self._wait(begun, "a new episode")
        return self._seen.popleft()

    def close(self) -> None:
        """Leave the graph."""
        self._loop.close()
        runtime.destroy_publishers(self._node, *self._node.publishers)
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    # ------------------------------------------------------------ waiting

    def _drop(self, unwanted: Callable[[Observation], bool]) -> None:
        while self._seen and unwanted(self._seen[0]):
            self._seen.popleft()

    def _vehicle(self) -> str | None:
        """Name of the node that is the vehicle, if it can begin anew."""
        base = self._node.get_namespace().rstrip("/")
        known = {name for name, _ in self._node.get_service_names_and_types()}
        return next((f"{base}/{v}" for v in VEHICLES if f"{base}/{v}/reset" in known), None)

    def _call(self, kind: Any, service: str, request: Any) -> Any:
        client = self._node.create_client(kind, service)
        try:
            self._wait(client.service_is_ready, f"service {service}")
            future = client.call_async(request)
            self._wait(future.done, f"an answer of {service}")
            return future.result()
        finally:
            self._node.destroy_client(client)

    def _wait(self, ready: Callable[[], bool], what: str) -> None:
        if not self._spin(ready, self._timeout):
            self._alive()
            raise InputError(f"{what} did not come within {self._timeout:g} s")

    def _spin(self, ready: Callable[[], bool], timeout: float) -> bool:
        """Handle events until `ready`; whether it was in time."""
        end = time.monotonic() + timeout
        while not ready():
            self._loop.once(0.02)
            if self._conflict:
                raise InputError(self._conflict)
            if time.monotonic() > end:
                return False
        return True
