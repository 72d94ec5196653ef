"""Any connected graph of springs on a line."""
