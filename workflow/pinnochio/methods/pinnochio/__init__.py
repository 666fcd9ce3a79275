"""PINNOCHIO: the patient as its graph networks read it, its losses, its training and its prediction."""
