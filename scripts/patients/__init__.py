"""The stages of new patients."""
