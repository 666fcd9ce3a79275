"""What a second of computing buys."""
