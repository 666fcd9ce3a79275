"""What the stages cost against size."""
