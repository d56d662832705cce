"""The report on a material: tables, pictures, page."""
