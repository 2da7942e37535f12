"""The paper's four experiments as planning models: geometry, contact, noise, prior, cost; one a file."""
