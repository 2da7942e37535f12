"""Diagnosis of jointed robots: their rows, the first-order tests of effects, and the locations of a misfit."""
