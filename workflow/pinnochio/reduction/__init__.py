"""Models reduced to what a plan requires."""
