"""Robots and objects of the packaged scenarios, as model files."""
