"""Model discrimination: motions that tell two explanations apart, and the odds after a run of them."""
