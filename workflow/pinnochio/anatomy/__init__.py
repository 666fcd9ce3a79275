"""What a patient is: labels, surfaces, plans and the model that every method reads."""
