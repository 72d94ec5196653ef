"""The crawler in rerun, live and from recordings."""
