"""Questions beside the core, one folder a study; the core imports nothing of them."""
