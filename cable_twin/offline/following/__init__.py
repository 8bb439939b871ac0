"""Parts of the command `follow`: measurements and commands of a recorded plant in the order of time, and plots."""
