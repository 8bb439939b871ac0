"""Terminal output of the commands: options, faults, progress bars and the status bar."""
