"""The nodes `simulator` and `gait_player`."""
