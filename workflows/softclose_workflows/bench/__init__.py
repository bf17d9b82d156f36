"""The room of benches: campaigns whose responses are measured."""
