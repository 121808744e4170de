"""The nodes of the graph. They pair messages, call the core and publish."""
