"""One file per command of `softclose`. Heavy imports wait until a command runs, so that `--help` is instant."""
