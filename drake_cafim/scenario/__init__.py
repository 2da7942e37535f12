"""Scenario files: a robot's model, sensor channels, unknown parameters, contacts and effects, read and checked."""
