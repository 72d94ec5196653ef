"""Sliding blocks of many contacts, which are followed without touching their contacts."""
