"""The search from a misfit to the effects that explain it."""
