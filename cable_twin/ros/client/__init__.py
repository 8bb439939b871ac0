"""Commands that talk to a running twin."""
