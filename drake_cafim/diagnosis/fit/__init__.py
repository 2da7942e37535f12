"""Maximum a posteriori fits to whitened rows, and the statistical tests of a larger model against a smaller one."""
