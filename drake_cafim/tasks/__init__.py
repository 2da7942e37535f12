"""The paper's four experiments as planning models, one in each file: geometry, contact, noise, prior and cost."""
