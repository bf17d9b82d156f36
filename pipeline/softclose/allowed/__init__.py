"""What a setting may be: shared types and limits, and what is said of a value that is not allowed."""
