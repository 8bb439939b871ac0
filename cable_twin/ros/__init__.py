"""ROS 2 interface: the node of `sim` and the terminal command `drive`."""
