"""What every method does at the extremes."""
