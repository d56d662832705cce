"""A virtual gantry that photographs swatches along an arc."""
