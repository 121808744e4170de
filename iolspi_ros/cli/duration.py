"""How long to learn: vehicle time or episodes, whichever the user thinks in."""

from __future__ import annotations

from iolspi_ros.errors import InputError, check_range
from sim_nodes.tasks.base import USUAL_EPISODES, Task

SECONDS = "Vehicle time to learn online, in episodes of full length; pendulum: 120."
EPISODES = "Episodes to learn online, instead of --seconds; slung_load: 1000."


def episodes_to_fly(task: Task, seconds: float | None, episodes: int | None, least: int) -> int:
    """Episodes that the two options ask for; the task's own number by default.

    Raises
    ------
    InputError
        When both are given, or one is not within its limits.
    """
    if seconds is not None and episodes is not None:
        raise InputError("--seconds and --episodes are both given; allowed: one of them")
    if episodes is not None:
        check_range("--episodes", episodes, least, 1e6)
        return episodes
    if seconds is None:
        return int(getattr(task, "usual_episodes", USUAL_EPISODES))
    full = task.description.episode_time
    check_range("--seconds", seconds, least * full, 1e6)
    return round(seconds / full)
