"""Ground that changes with place: the event loops of chains and graphs, resumed at every border."""
