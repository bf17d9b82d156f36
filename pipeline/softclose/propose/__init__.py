"""Engines that propose waveforms, one file each. Every engine is a pure function of the recorded history."""
