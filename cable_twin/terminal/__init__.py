"""What commands show in a terminal: options and faults, bars of progress, the status bar."""
