"""What the lot and the drive do to a result: tolerance of the drive, sensitivity to the population."""
