"""What checks the virtual cohort beyond making it."""
