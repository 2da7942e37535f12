"""From recordings and a model to a verdict: where they differ, which physics is missing, and how sure that is."""
