"""The algorithm: features, moments, least-squares policy iteration. No ROS here."""
