"""What is known of a measurement beside its format: symmetries, energy, gaps, and how well it predicts itself."""
