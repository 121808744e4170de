"""A joystick as a source of actions."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from sensor_msgs.msg import Joy

from iolspi_ros.settings import Settings, setting


@dataclass(frozen=True)
class JoystickSettings(Settings):
    """What the parts of the joystick mean."""

    joy_axis: int = setting(0, "axis of the stick, from its first action to its last", low=0)
    joy_actions: int = setting(
        0, "how many of the actions, from the first, are on the axis; 0 for all", low=0
    )
    joy_inverted: bool = setting(
        True, "whether the positive end of the axis (left, in most drivers) is the first action"
    )
    joy_buttons: tuple[int, ...] = setting(
        (-1,), "action of each button while it is held; -1 for none", low=-1
    )
    joy_timeout: float = setting(
        0.5, "neutral when the stick was not heard for this long [s]", low=0.01, high=3600.0
    )


class Joystick:
    """Turns the latest sensor_msgs/Joy into an action.

    Parameters
    ----------
    settings : JoystickSettings
    n_actions, neutral : int
        Number of actions, and the one for a stick that is let go or silent.
    """

    def __init__(self, settings: JoystickSettings, n_actions: int, neutral: int) -> None:
        self._settings, self._n_actions, self._neutral = settings, n_actions, neutral
        self._on_axis = min(settings.joy_actions or n_actions, n_actions)
        self._latest: Joy | None = None
        self._time = 0.0

    def take(self, message: Joy) -> None:
        """Remember where the stick is."""
        self._latest, self._time = message, time.monotonic()

    def action(self) -> int:
        """Action of a held button, else of the axis; neutral when the stick is silent."""
        s = self._settings
        if self._latest is None or time.monotonic() - self._time > s.joy_timeout:
            return self._neutral
        for button, action in zip(self._latest.buttons, s.joy_buttons, strict=False):
            if button and 0 <= action < self._n_actions:
                return action
        if s.joy_axis >= len(self._latest.axes):
            return self._neutral
        value = float(np.clip(np.nan_to_num(self._latest.axes[s.joy_axis]), -1.0, 1.0))
        if s.joy_inverted:
            value = -value
        return round((value + 1.0) / 2.0 * (self._on_axis - 1))
