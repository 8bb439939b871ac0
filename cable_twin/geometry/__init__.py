"""Where outlines of vehicles are, and how high rope and vehicles are above the ground."""
