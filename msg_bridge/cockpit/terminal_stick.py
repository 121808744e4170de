"""Publishes a terminal's keyboard as `joy`."""

from __future__ import annotations

import os
import select
import sys
import termios
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import Joy
from std_srvs.srv import Trigger

from iolspi_ros import qos, runtime
from iolspi_ros.errors import InputError
from msg_bridge.cockpit.board import Board
from msg_bridge.cockpit.keyboard import VERDICTS, Keyboard, keys
from msg_bridge.cockpit.virtual_joystick import Deflection

PERIOD = 0.05
"""Seconds between two messages at least as long as nothing changes."""


@contextmanager
def key_by_key() -> Iterator[int]:
    """A terminal that hands over each key as it comes and shows none; as it was afterwards.

    Raises
    ------
    InputError
        Where there is none.
    """
    if not sys.stdin.isatty():
        raise InputError("--stick needs a keyboard; allowed: in a terminal")
    file = sys.stdin.fileno()
    before = termios.tcgetattr(file)
    try:
        tty.setcbreak(file)
        yield file
    finally:
        termios.tcsetattr(file, termios.TCSADRAIN, before)


class TerminalStick:
    """Reads keys, and says where the stick is: at each change, and as long as somebody looks.

    Parameters
    ----------
    node : Node
    board : Board
        Which knows the task, once it was heard; shows what the demonstrator answers.
    file : int
        The terminal.
    """

    def __init__(self, node: Node, board: Board, file: int) -> None:
        self._node, self._board, self._file = node, board, file
        self._out = node.create_publisher(Joy, "joy", qos.CONTROL)
        self._verdicts: dict[str, Any] = {
            name: node.create_client(Trigger, f"demonstrator/{name}") for name in VERDICTS.values()
        }
        self._keyboard: Keyboard | None = None
        self._said, self._when = Deflection(), 0.0

    def look(self) -> None:
        """Take the keys that came, and publish."""
        text = ""
        while select.select([self._file], [], [], 0.0)[0]:
            read = os.read(self._file, 1024)
            if not read:
                break
            text += read.decode(errors="ignore")
        task = self._board.get("task")
        if task is None:
            return
        keyboard = self._keyboard = self._keyboard or Keyboard(len(task["actions"]))
        now = time.monotonic()
        for key in keys(text):
            if key in VERDICTS:
                self._call(VERDICTS[key])
            keyboard.press(key, now)
        at = keyboard.at(now)
        if at != self._said or now - self._when >= PERIOD:
            self._publish(at, now)

    def _publish(self, at: Deflection, now: float) -> None:
        self._said, self._when = at, now
        message = Joy(axes=list(at.axes), buttons=list(at.buttons))
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.header.frame_id = "terminal"
        self._out.publish(message)

    def _call(self, verdict: str) -> None:
        client = self._verdicts[verdict]
        if not client.service_is_ready():
            self._board.put("said", {"text": f"{verdict}: there is no demonstrator", "good": False})
            return

        def answered(future: Any) -> None:
            answer = future.result()
            self._board.put("said", {"text": answer.message, "good": answer.success})

        client.call_async(Trigger.Request()).add_done_callback(answered)

    def close(self) -> None:
        """Centre the stick, and say nothing more."""
        if self._keyboard is not None:
            self._publish(Keyboard(len(self._said.buttons) - 1).at(0.0), 0.0)
        runtime.destroy_publishers(self._node, self._out)
