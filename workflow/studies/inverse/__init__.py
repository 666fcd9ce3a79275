"""How well a motion is recovered from the face that it made."""
