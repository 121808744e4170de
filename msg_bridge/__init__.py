"""To the outside world: conversions between this graph's frames and an autopilot's."""
