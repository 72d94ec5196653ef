"""The `crawler` command: one verb a file, thin over the model, the nodes and the recordings."""
