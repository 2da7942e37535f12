"""The next experiment: motions that tell two explanations apart, and what a run of them says."""
