"""Terminal output of the commands: options, error messages, progress bars and the status bar."""
