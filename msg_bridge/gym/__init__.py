"""The graph as an environment of Gymnasium: anybody's learner in the learner's place."""

ID = "iolspi_ros/Graph-v0"


def register() -> None:
    """Let `gymnasium.make` find it; the entry point `gymnasium.envs` calls this, once."""
    import gymnasium

    if ID not in gymnasium.registry:
        gymnasium.register(id=ID, entry_point="msg_bridge.gym.env:GraphEnv")
