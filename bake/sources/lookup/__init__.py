"""What readers share: bounded text, lookups on grids, and scattered samples made smooth."""
