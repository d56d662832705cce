"""A scene's lights as tables that materials aim at."""
