"""A library's jobs for farms that exist: Flamenco and OpenCue."""
