"""How a body follows its commands: one contract, three implementations."""
