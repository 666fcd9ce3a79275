"""Plans solved on what they require of a patient."""
