"""Blades from files, and to them: sections of other programs and spreadsheets as a `Beam`."""
