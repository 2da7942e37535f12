"""Maximum a posteriori fits to whitened rows, and what counts as evidence for a larger model."""
