"""Many cases: grids and lists of them, tables of results, folders, devices."""
