"""Several campaigns at once: series, studies over a parameter, the reproduction of the published study."""
