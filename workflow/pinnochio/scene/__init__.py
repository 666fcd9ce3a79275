"""What a patient and a plan require to be modelled."""
