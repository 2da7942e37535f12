"""Scenarios: what a model, its channels, its unknowns and its contacts are, and the Scene that is built from them."""
