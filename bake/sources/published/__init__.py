"""Published fits of measured materials: their formulas, and the files that hold the parameters."""
