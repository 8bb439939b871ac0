"""Parts of the command `calibrate`: parameters, measured data, the check of what they can tell, the solve, results."""
