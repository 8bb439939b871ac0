"""Report of a run or of load cases: one HTML page with its sections, each a class with a template of its own."""
