"""What every room may use: texts that can be printed, units, YAML within limits, files on a disk."""
