"""Chains: exact from event to event, or by a projection in O(N)."""
