"""Populations of switches: distributions, samples, the TOML form, and calibration from measured devices."""

from softclose.population.distributions import PopulationError as PopulationError
from softclose.population.files import load_population as load_population
from softclose.population.files import population_names as population_names
from softclose.population.population import UNITS as UNITS
from softclose.population.population import VARIABLES as VARIABLES
from softclose.population.population import Population as Population
from softclose.population.population import Sampling as Sampling
from softclose.population.population import switches_from_parameters as switches_from_parameters
