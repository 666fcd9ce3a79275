"""What a patient is: labels, surfaces, landmarks, regions, the tetrahedral model and the fields predicted on it."""
