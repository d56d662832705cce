"""What accuracy costs in time and memory: measurements, charts of them, and a page that shows both."""
