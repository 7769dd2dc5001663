"""Fits a camera's free parameters to frames: simulated sets, derivatives, refits, and the distribution of what they leave."""
