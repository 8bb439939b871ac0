"""Runtime of a twin, independent of ROS: real-time frame loop, goals, watches, output and companion processes."""
