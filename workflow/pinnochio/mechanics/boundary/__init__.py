"""What acts on the tissue from outside: bone that holds or moves it, sliding, contact, loads."""
