"""What more training patients are worth."""
