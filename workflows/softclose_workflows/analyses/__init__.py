"""Questions to a finished or growing store: certify, rescore, recompute, engines side by side."""
