"""Parts of the command `calibrate`: parameters, measured data, identifiability check, solve, results."""
