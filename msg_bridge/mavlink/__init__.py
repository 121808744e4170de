"""MAVLink autopilots in place of the simulator: link, profiles, envelope, authority, node."""
