"""Diagnoses of recordings that do not fit into memory: in parts, a look at each, a search on those that tell most."""
