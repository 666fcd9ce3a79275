"""The stages that predict."""
