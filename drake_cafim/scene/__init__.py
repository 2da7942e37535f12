"""The class `Scene`: a scenario built as a Drake plant, with its physics, channels and unknown parameters."""
