"""Pictures of a run from plain arrays: kymograph, forces, commands, path in the plane, and the page of all of them."""
