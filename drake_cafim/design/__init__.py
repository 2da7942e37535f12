"""CA-OED, contact-aware optimal experiment design: motions whose contacts are most informative about θ."""
