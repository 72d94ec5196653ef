"""The best periodic drive of a crawler within bounds."""
