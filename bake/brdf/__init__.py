"""A baked BRDF as its bundle describes it: `record.BrdfRecord`, read once and checked there and nowhere else."""
