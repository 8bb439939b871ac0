"""Parts of the command `follow`: the plant's messages in the order of time, and plots."""
