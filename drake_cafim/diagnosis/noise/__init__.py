"""Models of the noise in recorded channels: white, correlated in time, quantised, or fed back by a controller."""
