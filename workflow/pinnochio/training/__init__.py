"""Losses, data and loops that train the networks."""
