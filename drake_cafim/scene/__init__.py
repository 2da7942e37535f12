"""A scene: what a scenario says, built as a Drake plant with its physics, channels and unknowns."""
