"""Packaged scenarios as Drake Diagrams: robots, contact, control and sensors; each scenario has a YAML file."""
