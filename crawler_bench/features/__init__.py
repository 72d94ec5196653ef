"""Features that run many times in this process: variations, derivatives, searches, fits, environments, films."""
