"""Reading a campaign: the reader's view, lazy rows, and blocks against their markers."""
