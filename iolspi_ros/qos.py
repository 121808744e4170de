"""Quality-of-service profiles, each named once."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

CONTROL = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
"""state, reward, action, joy, /clock: only what is fresh matters."""

SAMPLES = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)
"""sample: none may be lost, so a fast writer waits for a slow reader."""

REPORTS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
"""score, update, weights, /diagnostics: for plots and records."""

LATCHED = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""demonstration: whoever comes late still hears the last word."""
