"""Writing a campaign: creating it, storing blocks (workers) and committing waves (the driver)."""
