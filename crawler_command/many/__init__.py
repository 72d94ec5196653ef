"""Many runs at a time: sweeps of a scene, recordings by the hundred, and the cores or cluster that both run on."""
