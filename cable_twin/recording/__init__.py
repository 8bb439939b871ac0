"""Logs of a run: MCAP and rerun writers, the writing thread, and snapshots read back from a log."""

import os

# before rerun is imported: what its writer says of a full disk, we say ourselves, in one line
os.environ.setdefault("RUST_LOG", "warn,re_log_encoding=off")
