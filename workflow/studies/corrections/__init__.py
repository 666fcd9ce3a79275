"""What Newton corrections of a network's field are worth."""
