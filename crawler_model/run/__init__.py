"""A drive followed from its start to its end, with the account of its energy."""
