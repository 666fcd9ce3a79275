"""From a wished face to a plan, and how well a motion is recovered from the face that it made."""
