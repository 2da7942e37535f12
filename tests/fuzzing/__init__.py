"""Hostile inputs, made from seeds, for every reader, scenario, model and command line; see `table`."""
