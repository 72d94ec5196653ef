"""What a fit decides: verdicts, intervals, bounds, and what a misfit means."""
