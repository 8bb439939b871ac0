"""Lines at rest with a vehicle at many places: their calculation and its picture, for `line` and all that needs it."""
