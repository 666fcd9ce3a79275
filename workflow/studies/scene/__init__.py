"""What solving only what a plan requires saves."""
