"""The sections of a scenario: what each key may be by itself."""
