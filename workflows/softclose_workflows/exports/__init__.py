"""Waveforms and tables in the forms that instruments, circuit simulators and other programs read. One form per file."""
