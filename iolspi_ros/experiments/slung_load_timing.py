"""How long learning takes."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.experiments.headless import Listener, train
from sim_nodes.tasks.slung_load import SlungLoad
from sim_nodes.world import World, WorldSettings


def timed(setting: LSPISettings, seed: int) -> Mapping[str, Any]:
    """1,000 episodes of the slung load from nothing, when everything is compiled (T Table 3).

    Returns
    -------
    seconds : float
    samples : int
    """
    task: Any = SlungLoad()
    for episodes in (2, 1000):
        core = OnlineLSPI(task.description, setting, np.random.default_rng([seed, 1]))
        world = World(task, WorldSettings(), np.random.default_rng([seed, 0]))
        begin = time.perf_counter()
        train(world, core, episodes, Listener())
        seconds = time.perf_counter() - begin
    return {"seconds": seconds, "samples": core.step}
