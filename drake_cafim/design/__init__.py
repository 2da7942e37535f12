"""CA-OED: motions whose contacts tell most about the unknown parameters."""
