"""The `crawler` command: one file per verb, thin over the model, the nodes and the recordings."""
