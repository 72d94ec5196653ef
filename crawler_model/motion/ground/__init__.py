"""Ground that changes with place: the event loops of chains and graphs, resumed where they stop at a border."""
