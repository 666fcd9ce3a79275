"""The stages that make what belongs to a patient, once for all plans."""
