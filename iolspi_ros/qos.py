"""Quality-of-service profiles, each named once."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

CONTROL = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
"""Who listens to state, reward, action or joy to act on them: only what is fresh matters."""

SAMPLES = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)
"""sample: none may be lost, so a fast writer waits for a slow reader."""

REPORTS = QoSProfile(
    depth=1000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""score, update, weights: whoever comes late still gets what was."""

OUTGOING = QoSProfile(depth=10_000, reliability=ReliabilityPolicy.RELIABLE)
"""Who publishes any of those, and /diagnostics. Deep, so that a recorder still gets what the
transport dropped when it was slow: DDS notices such a loss only after seconds."""

RECORDING = QoSProfile(depth=10_000, reliability=ReliabilityPolicy.RELIABLE)
"""Who listens to keep everything."""

LATCHED = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""task, demonstration, takeover, piloting: whoever comes late still hears the last word."""

TASK = QoSProfile(
    depth=10,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Who listens to task: every vehicle in the graph is heard, should there be more than one."""

WATCHING = QoSProfile(depth=64, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Who shows state and reward to people: nobody waits for eyes, and nothing is sent again."""
