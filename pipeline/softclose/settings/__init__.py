"""A campaign's configuration, one section a file; those of conditions are beside what they configure."""

from softclose.settings.config import CampaignConfig as CampaignConfig
from softclose.settings.config import canonical_json as canonical_json
from softclose.settings.config import known_keys as known_keys
from softclose.settings.errors import ConfigError as ConfigError
from softclose.settings.read import load_config as load_config
from softclose.settings.read import read_toml as read_toml
