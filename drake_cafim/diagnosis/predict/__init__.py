"""Predictions of a recording under a model: one-step innovations and simulations over short horizons."""
