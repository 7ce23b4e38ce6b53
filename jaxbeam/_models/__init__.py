"""Theories of a rotating beam, one file each."""
