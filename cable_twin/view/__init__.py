"""Pictures in rerun: ropes, vehicles, plots and readouts, live and of logs."""
