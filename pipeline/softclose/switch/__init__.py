"""What one switch is: the plate of Eqs. 3-6, its losses, its reduced-order model."""
