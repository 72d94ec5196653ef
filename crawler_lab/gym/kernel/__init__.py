"""The compiled step of the environments: one call advances all of them."""
