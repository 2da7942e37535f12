"""What a run leaves to look at: the replay, and later the figures and pages."""
