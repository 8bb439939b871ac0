"""Lines at rest with a vehicle at many places: calculation and picture, for `line` and other commands."""
