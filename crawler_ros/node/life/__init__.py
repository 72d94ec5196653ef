"""The life of a node, from its command line to its exit status: signals, log, shared memory, domain."""
