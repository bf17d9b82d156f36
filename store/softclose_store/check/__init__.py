"""Keeping a store whole: finding damage, repairing it, setting strays aside."""
