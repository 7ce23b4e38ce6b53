"""Theories of the beam, one file each, all with the contract of `base`."""
