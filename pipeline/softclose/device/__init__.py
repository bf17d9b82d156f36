"""The device models: their protocol, the shipped one, and switches whose drives are scaled."""
