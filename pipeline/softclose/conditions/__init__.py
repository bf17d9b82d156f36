"""What stands between a lot and its drive: trim, learned trim, amplifier, temperature; one file each."""
