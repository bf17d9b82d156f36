"""Owns the error of a configuration that cannot be used."""

from __future__ import annotations


class ConfigError(ValueError):
    """A configuration that cannot be used; the message lists every problem found."""
