"""A robot's own topics as a vehicle: what a YAML file says, and the node that follows it."""
