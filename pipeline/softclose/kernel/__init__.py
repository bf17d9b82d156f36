"""The fast integrator of Eqs. 1-2: Taylor series, contact, release, and a readable Runge-Kutta twin."""
