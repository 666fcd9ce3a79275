"""What is measured of a prediction: surface, volume, validity, regions."""
