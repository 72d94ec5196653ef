"""Films of a run: the moving body, the kymograph, and the stasis domain that moves with it, as mp4, gif or a page."""
