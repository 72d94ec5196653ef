"""From a scene file to arrays: parts, checks, assembly."""
