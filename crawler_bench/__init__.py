"""Time against error: every method of ours and of its peers on the same crawlers, in one run on one machine.

    case (scene, exact answer) --> entrants (a method at a number of ticks a period) --> rows --> table, JSON, pictures

An entrant simulates two periods, in which its displacement is compared with the exact one at every quarter of a
period. Then all entrants of a case are timed in turn, several rounds, and the median counts. Nothing here is imported
by the model or by the other verbs, and no peer before it is measured.
"""
