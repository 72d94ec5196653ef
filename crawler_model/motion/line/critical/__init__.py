"""Critical states of the body, or of a part of it: nothing determines the translation, and one is chosen."""
