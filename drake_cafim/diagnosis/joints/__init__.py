"""Recordings of jointed robots: hypotheses about what their model lacks, and where it differs."""
