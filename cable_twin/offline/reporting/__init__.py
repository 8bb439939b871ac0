"""Report of a run, load cases or a study: one HTML page of sections, each a function with a template of its own."""
