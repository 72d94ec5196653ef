"""What a fit predicts of another drive."""
