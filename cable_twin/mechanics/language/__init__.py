"""What the mechanics are written in: vectors, lanes, memory, records by reference, compilation."""
