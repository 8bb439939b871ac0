"""Lines at rest with a vehicle at many places: calculation and plot, for `line` and other commands."""
