"""The stages that make the virtual cohort."""
