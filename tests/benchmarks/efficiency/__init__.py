"""How near the fits of a diagnosis come to the Cramér–Rao bound of their recordings."""
