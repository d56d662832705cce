"""What an artist changes of a measured material without a bake, and what becomes of its energy."""
