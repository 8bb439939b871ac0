"""Parts of the command `envelope`: load cases of a file, their equilibria and runs, and the plot of their extremes."""
