"""What values may not be together, and how a fault is told."""
