"""Logs of a run: MCAP, rerun, the thread that writes them, and the way back from a log to snapshots."""

import os

# before rerun is imported: what its writer says of a full disk, we say ourselves, in one line
os.environ.setdefault("RUST_LOG", "warn,re_log_encoding=off")
