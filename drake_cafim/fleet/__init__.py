"""Fleets: the folders of many robots, the strengths of their effects over time, and what changed."""
