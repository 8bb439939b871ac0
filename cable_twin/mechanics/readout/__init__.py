"""What can be read from a state."""
