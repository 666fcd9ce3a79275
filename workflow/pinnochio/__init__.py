"""Facial soft-tissue prediction for orthognathic surgery: mechanics, networks, studies."""
