"""Studies: tables, figures and claims from many runs that differ in seed, policy, prior, noise or world."""
