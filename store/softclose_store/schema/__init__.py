"""What a store holds: its fields, its sizes, its digests, its root, and the empty hierarchy."""
