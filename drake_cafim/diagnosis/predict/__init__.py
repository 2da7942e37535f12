"""Predictions of a recording under a model: one-step innovations, open-loop simulations, inverse dynamics."""
