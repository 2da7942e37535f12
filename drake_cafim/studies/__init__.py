"""Studies: many runs from one seed, and what they say of the paper's claims."""
