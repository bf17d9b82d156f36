"""How bytes reach a store: paths and URLs, keys, whole-file writes, zarr's coroutines, the one-driver lock."""
