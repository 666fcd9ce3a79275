"""What each switch of the better network is worth."""
