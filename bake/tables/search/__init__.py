"""Which grid suits a source."""
