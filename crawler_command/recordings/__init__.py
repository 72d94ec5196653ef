"""Recordings by the hundred as one data set, and recordings and scenes side by side."""
