"""The fit of a hypothesis: linearisation, filter, noise, errors of laws."""
