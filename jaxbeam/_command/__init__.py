"""What `python -m jaxbeam` reads: scenes in TOML, and the questions that they ask."""
