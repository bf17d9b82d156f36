"""The one way of a switch: where a configuration meets a waveform. Every command, engine and analysis walks it."""

from softclose.evaluate.chain import combinations as combinations
from softclose.evaluate.judging import evaluate as evaluate
from softclose.evaluate.judging import judge as judge
from softclose.evaluate.realise import coordinates as coordinates
from softclose.evaluate.realise import draw as draw
from softclose.evaluate.realise import realise as realise
from softclose.evaluate.realise import uniforms as uniforms
from softclose.evaluate.respond import counted as counted
from softclose.evaluate.respond import respond as respond
from softclose.evaluate.respond import respond_each as respond_each
from softclose.evaluate.scoring import objective_settings as objective_settings
