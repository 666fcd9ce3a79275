"""From a wished face to a plan: what may move, what is wished, and the motion that meets it."""
