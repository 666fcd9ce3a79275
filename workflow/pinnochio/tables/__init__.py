"""The tables of the study, one file each, and the engine that writes them."""
