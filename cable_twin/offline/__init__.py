"""Offline tools without ROS: run a scenario, review a log, and replay it."""
