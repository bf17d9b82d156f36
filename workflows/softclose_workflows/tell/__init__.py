"""What a person is told at the terminal: tables, status, the live view, labels."""
