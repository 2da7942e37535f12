"""The search for the effects that explain a misfit."""
