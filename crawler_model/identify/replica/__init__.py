"""The model under recorded commands, with its derivatives."""
