"""Each effect of the vocabulary simulated by Drake, found in its own recording, and followed by the corrected scene."""
