"""From a key pressed in the browser to the action on the wire, with a learner at work beside.

usage: .venv/bin/python benchmarks/cockpit_latency.py [PRESSES]

Needs Debian's chromium and chromium-driver. The simulator runs in real time; the learner learns
from a shipped set and goes on while it flies; a script takes over by the keys of the page and
presses left and right in turn. What is measured goes from the browser's own time of the key to the
arrival of the first `action` that it brought about at another process.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "test"))

from chromium import Browser  # noqa: E402

from iolspi_ros import graph, resources  # noqa: E402
from iolspi_ros.process import prepare  # noqa: E402

NOTE = """
    window.pressed = 0;
    window.addEventListener("keydown", (event) => {
      if (!event.repeat) window.pressed = performance.timeOrigin + event.timeStamp;
    }, {capture: true});
"""


def main() -> None:
    """Measure, and print a table."""
    presses = int(sys.argv[1]) if len(sys.argv) > 1 else 400
    with held_in_a_page() as (page, heard, until):
        found = [measured(page, heard, until, n) for n in range(presses)]
        updates = page.part("update")["number"]
    table("key to joy", [joy for joy, _ in found])
    table("key to action", [action for _, action in found])
    print(f"{presses} presses beside a learner with {updates:.0f} updates; load {os.getloadavg()}")


@contextmanager
def held_in_a_page(
    task: str = "pendulum", updates: int = 3
) -> Iterator[tuple[Browser, dict, Callable[..., None]]]:
    """A graph in real time, whose vehicle a page has taken over.

    Parameters
    ----------
    task : str
    updates : int
        Of the learner, before that.

    Yields
    ------
    page : Browser
        It holds space.
    heard : dict
        When the newest `joy` and human `action` that differed from the one before came, and what
        it was.
    until : callable
        Listens until something holds.
    """
    prepare()
    graph.isolate()
    import rclpy
    from sensor_msgs.msg import Joy
    from std_msgs.msg import Float64MultiArray

    from iolspi_ros import qos, wire
    from iolspi_ros.cli.cockpit import from_page, start_cockpit
    from iolspi_ros.core.learner import Source
    from sim_nodes.tasks import task_class

    rclpy.init()
    node = rclpy.create_node("listener")
    rows, heard = wire.Rows("action", wire.ACTION), {"joy": (0.0, -9.0), "action": (0.0, -1)}

    def on_action(message: object) -> None:
        values = rows.read(message)
        if values[5] == Source.HUMAN and values[4] != heard["action"][1]:
            heard["action"] = (time.time(), values[4])

    def on_joy(message: Joy) -> None:
        if message.axes[0] != heard["joy"][1]:
            heard["joy"] = (time.time(), message.axes[0])

    node.create_subscription(Float64MultiArray, "action", on_action, qos.CONTROL)
    node.create_subscription(Joy, "joy", on_joy, qos.CONTROL)

    def until(ready: Callable[[], bool], seconds: float = 60.0) -> None:
        end = time.monotonic() + seconds
        while not ready():
            if time.monotonic() > end:
                raise SystemExit("what was waited for did not happen")
            rclpy.spin_once(node, timeout_sec=0.02)

    folder, file = Path(tempfile.mkdtemp()), resources.config(task)
    bag = resources.find("demos", task, "set_5")
    with graph.Graph(folder) as nodes:
        address = start_cockpit(nodes, folder)
        nodes.start("simulator", {"task": task, "mode": "realtime"}, file)
        nodes.start("learner", {"background": True, "vehicle_timeout": 0.0}, file)
        n_actions = task_class(task).description.n_actions
        demonstrator = from_page(n_actions) | {"source": "bag", "bags": [str(bag)], "review": False}
        nodes.start("demonstrator", demonstrator, file)
        page = Browser()
        try:
            page.open(address)
            until(lambda: (page.part("update") or {}).get("number", 0) >= updates, 300.0)
            page.click("stick-button")
            until(lambda: "you have the stick" in page.text("crowd"))
            page.run(NOTE)
            page.press(" ")
            until(lambda: heard["action"][0] > 0)
            yield page, heard, until
            page.lift(" ")
        finally:
            page.close()
    node.destroy_node()
    rclpy.try_shutdown()


def measured(
    page: Browser, heard: dict, until: Callable[..., None], number: int
) -> tuple[float, float]:
    """Press left or right, wait for its action, and let go; times in ms."""
    key, axis, action = (("ArrowLeft", 1.0, 0), ("ArrowRight", -1.0, 2))[number % 2]
    page.press(key)
    until(lambda: heard["action"][1] == action and heard["joy"][1] == axis)
    begin = page.run("return window.pressed") / 1000
    joy, taken = heard["joy"][0], heard["action"][0]
    page.lift(key)
    until(lambda: heard["action"][1] == 1)
    return 1000 * (joy - begin), 1000 * (taken - begin)


def table(what: str, values: list[float]) -> None:
    """Print percentiles."""
    p50, p90, p99, most = np.percentile(values, [50, 90, 99, 100])
    print(f"{what}: p50 {p50:.1f} ms, p90 {p90:.1f} ms, p99 {p99:.1f} ms, most {most:.1f} ms")


if __name__ == "__main__":
    main()
