"""Packaged scenarios: each module builds a Drake Diagram, its YAML beside it."""
