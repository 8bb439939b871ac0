"""The ROS 2 side: the node `sim` and the terminal command `drive`."""
