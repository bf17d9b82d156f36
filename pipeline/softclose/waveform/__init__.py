"""Pulses and drive waveforms (Eqs. 12-13), and the spaces in which they are searched."""

from softclose.waveform.delivered import Delivered as Delivered
from softclose.waveform.fitted import Fitted as Fitted
from softclose.waveform.pieced import Pieced as Pieced
from softclose.waveform.pulses import LEAST_RISE_US as LEAST_RISE_US
from softclose.waveform.pulses import MAX_VOLTS as MAX_VOLTS
from softclose.waveform.pulses import MIN_RISE_US as MIN_RISE_US
from softclose.waveform.pulses import Pulse as Pulse
from softclose.waveform.pulses import Waveform as Waveform
from softclose.waveform.pulses import WaveformError as WaveformError
from softclose.waveform.pulses import is_above as is_above
from softclose.waveform.recorded import Record as Record
from softclose.waveform.recorded import read_record as read_record
from softclose.waveform.recorded import read_trace as read_trace
from softclose.waveform.trace import Trace as Trace

Drive = Waveform | Trace
"""What is commanded, or was recorded."""
AnyDrive = Waveform | Trace | Delivered | Pieced | Fitted
"""Whatever switches can be driven with."""
