"""A frame: what goes in and out of a simulation, one row of numbers with named columns, commands and signals."""
