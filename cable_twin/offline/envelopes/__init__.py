"""Parts of the command `envelope`: load cases of a file, their rests and runs, and the picture of their extremes."""
