"""Time against error of our methods and of their peers, on the same crawlers in one run on one machine.

    case (scene, exact answer) --> entrants (a method at a number of ticks a period) --> rows --> table, JSON, pictures

An entrant simulates two periods, in which its displacement is compared with the exact one at every quarter of a
period. Then all entrants of a case are timed in turn over several rounds, and the median counts. The model and the
other verbs import nothing from here, and a peer is imported only when it is measured.
"""
