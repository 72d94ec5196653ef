"""The methods that enter the comparison: ours and the peers, all of one shape."""
