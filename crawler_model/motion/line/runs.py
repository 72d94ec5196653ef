"""Long sliding blocks of a chain, whose contacts sleep: runs of them that a block treats like one spring and contact.

Through a run of sliding contacts, velocity and rate of tension change like through one spring with a contact behind it:

    v_behind = v_before + stretch + compliance rate,    rate_behind = rate + rise,

with `stretch` the velocity that its springs add if the rate before it is zero, and `rise` the sum of the rates of the
forces of its contacts. Such maps are composed, so runs form a tree: contacts make leaves, and as many sleeping runs
side by side, `ramp.search.leaf_size`, make a larger one. A block of n contacts then has some log n rows.

A sleeping run integrates over s its velocity and its rate, and s times each of them; displacements, tensions and work
follow when it wakes. It wakes when one of its contacts may turn round: v_i differs from what it was when last looked at
by the change of v_before and by the change of the rate, times at most the compliance of the run.
"""

from __future__ import annotations

import numpy as np

from ...compiled import inlined, lean
from .advance import move
from .path import elongation_rate, limit_of
from .records import BACKWARD, FORWARD


@lean
def _advance_run(run, s):
    """Integrate velocity and rate of a sleeping run up to s."""
    ds = s - run.since
    if ds > 0.0:
        middle = 0.5 * (s + run.since)
        run.time += ds
        run.way += run.v * ds
        run.pull += run.rate * ds
        run.time_moment += middle * ds
        run.way_moment += middle * run.v * ds
        run.pull_moment += middle * run.rate * ds
    run.since = s


@lean
def _begin_run(run, ramp, v, rate):
    """Let a run fall asleep at s."""
    run.sleeps, run.mark, run.since = 1, ramp.search.block, ramp.s
    run.v, run.rate = v, rate
    run.seen_v, run.seen_rate = v, rate
    run.time = run.way = run.pull = run.time_moment = run.way_moment = run.pull_moment = 0.0
    run.stretch = run.compliance = run.rise = 0.0
    run.least, run.most = np.inf, -np.inf


@lean
def _find_bounds(run, v, rate):
    """Bound the velocities of the contacts of a run: from below where they slide forward, else from above."""
    change = v - run.seen_v
    other = change + (rate - run.seen_rate) * run.compliance
    return run.least + min(change, other), run.most + max(change, other)


@lean
def _wake_children(runs, run, ramp):
    """Hand what a run of runs has integrated to its children."""
    stretch = compliance = rise = 0.0
    for k in range(run.child, run.child + ramp.search.leaf_size):
        child = runs[k]
        child.v, child.rate, child.since = run.v + (stretch + compliance * run.rate), run.rate + rise, run.since
        child.time += run.time
        child.way += run.way + stretch * run.time + compliance * run.pull
        child.pull += run.pull + rise * run.time
        child.time_moment += run.time_moment
        child.way_moment += run.way_moment + stretch * run.time_moment + compliance * run.pull_moment
        child.pull_moment += run.pull_moment + rise * run.time_moment
        stretch += child.stretch + rise * child.compliance
        compliance += child.compliance
        rise += child.rise


@lean
def _wake_contacts(contacts, springs, run, ramp):
    """Move the contacts and springs of a leaf, and account for their way; they slide on with the present velocities."""
    stretch = compliance = rise = 0.0
    for i in range(run.first, run.last + 1):
        spring, c = springs[i - 1], contacts[i]
        pull = run.pull + rise * run.time
        moment = run.pull_moment + rise * run.time_moment
        # the integral of T over s is s T at its end less s T at its beginning less the integral of s times the rate
        before, after = spring.tension, spring.tension + pull
        ramp.account.work -= spring.d_length * ((run.since * after - spring.since * before) - moment)
        spring.tension, spring.rate, spring.since, spring.moved = after, run.rate + rise, run.since, 1
        stretch += spring.d_length + rise * spring.compliance
        compliance += spring.compliance
        way = run.way + stretch * run.time + compliance * run.pull
        moment = run.way_moment + stretch * run.time_moment + compliance * run.pull_moment
        c.v = run.v + (stretch + compliance * run.rate)
        if c.bounds_met & FORWARD:
            ramp.account.dissipation += c.forward * way + c.d_forward * moment
        else:
            ramp.account.dissipation -= c.backward * way + c.d_backward * moment
        ramp.account.loads_work += c.load * way + c.d_load * moment
        move(c, way)
        c.force += c.force_rate * (run.since - c.since)
        c.since = run.since
        rise += c.force_rate


@lean
def _wake(contacts, springs, runs, ramp, k):
    """Wake run k: its children sleep on, or its contacts are known where it was last advanced to."""
    run = runs[k]
    run.sleeps = 0
    if run.child >= 0:
        _wake_children(runs, run, ramp)
    else:
        _wake_contacts(contacts, springs, run, ramp)


@lean
def _wake_within(contacts, springs, runs, ramp, first, last):
    """Wake the runs that lie within contacts first .. last, parents before their children."""
    for k in range(runs.shape[0] - 1, -1, -1):
        if runs[k].sleeps and first <= runs[k].first and runs[k].last <= last:
            _wake(contacts, springs, runs, ramp, k)


@lean
def wake_all(contacts, springs, runs, ramp):
    """Wake all runs: their contacts are moved, and their account is added to the ramp's.

    Returns:
        Whether any were asleep; blocks found before must then be found anew.
    """
    if runs is None:
        return False
    asleep = ramp.search.asleep != 0
    if asleep:
        ramp.search.asleep = 0
        _wake_within(contacts, springs, runs, ramp, 0, contacts.shape[0] - 1)
    return asleep


@inlined
def wake_block(contacts, springs, block, runs, ramp, count):
    """Wake the runs of a block, which must then be found anew.

    Args:
        ramp: the RAMP; `woken` is set if there are any.

    Returns:
        Whether any were asleep.
    """
    if runs is None:
        return False
    found = False
    for j in range(count if ramp.search.asleep else 0):
        found |= block[j].run >= 0
    if not found:
        return False
    last = block[count - 1].contact
    _wake_within(contacts, springs, runs, ramp, last + 1 - ramp.search.path, last)
    ramp.search.woken = 1
    return True


@inlined
def find_run(runs, ramp, i):
    """Find the largest sleeping run of a contact.

    Returns:
        Its index; -1 if the contact is awake.
    """
    if runs is None or not ramp.search.asleep:
        return -1
    k = i // ramp.search.leaf_size
    if not runs[k].sleeps:
        return -1
    while runs[k].parent >= 0 and runs[runs[k].parent].sleeps:
        k = runs[k].parent
    return k


@inlined
def find_span(runs, ramp, i):
    """Find the first and the last contact of the largest sleeping run of a contact.

    Returns:
        The two contacts; both are the contact itself if it is awake.
    """
    if runs is None:
        return i, i
    k = find_run(runs, ramp, i)
    return (runs[k].first, runs[k].last) if k >= 0 else (i, i)


@inlined
def enter_run(contacts, runs, e, k):
    """Enter a run in a row of the block, as an equivalent spring and contact.

    Args:
        e: the BLOCK.
        k: index of the run.
    """
    if runs is None:
        return
    run = runs[k]
    e.run, e.contact = k, run.last
    e.side = 1 if contacts[run.last].bounds_met & FORWARD else -1
    e.upper = e.lower = run.rise
    e.blur = 0.0
    e.spring, e.sign = run.first - 1, 1.0
    e.compliance, e.trial = run.compliance, -run.stretch / run.compliance


@inlined
def wake_turning(contacts, springs, block, runs, ramp, count):
    """Wake the runs of a solved block in which a contact may turn round.

    Returns:
        Whether there are any; the block must then be found anew.
    """
    if runs is None:
        return False
    for j in range(count if ramp.search.asleep else 0):
        e = block[j]
        if e.run < 0:
            continue
        least, most = _find_bounds(runs[e.run], e.v - elongation_rate(e.flow, e.trial, e.compliance), e.flow)
        if least < 0.0 or most > 0.0:
            _wake(contacts, springs, runs, ramp, e.run)
            ramp.search.woken = 1
    return ramp.search.woken != 0


@inlined
def set_runs(springs, block, runs, ramp, count):
    """Give the sleeping runs of a solved block the velocities and rates that were found."""
    if runs is None:
        return
    for j in range(count if ramp.search.asleep else 0):
        e = block[j]
        if e.run >= 0:
            run = runs[e.run]
            _advance_run(run, ramp.s)
            run.v, run.rate = e.v - elongation_rate(e.flow, e.trial, e.compliance), e.flow
            run.mark = ramp.search.block
            springs[e.spring].rate = e.flow  # for the wall before it


@lean
def _sleeps_soundly(c, e):
    """Determine whether a contact slides with its bound for as long as no event changes its block."""
    return e.run < 0 and e.v * e.side > 0.0 and c.side == e.side and c.leaving == 0 and c.next > 1.0


@lean
def _form_leaf(contacts, springs, block, run, ramp, j):
    """Let the contacts of rows j .. fall asleep as a leaf if all of them slide; returns whether they do."""
    for t in range(ramp.search.leaf_size):
        e = block[j + t]
        c = contacts[e.contact]
        if not _sleeps_soundly(c, e) or c.bounds_met == FORWARD | BACKWARD:
            return False
    e = block[j]
    _begin_run(run, ramp, e.v - elongation_rate(e.flow, e.trial, e.compliance), e.flow)
    for t in range(ramp.search.leaf_size):
        e = block[j + t]
        spring = springs[e.spring]
        run.stretch += spring.d_length + run.rise * spring.compliance
        run.compliance += spring.compliance
        run.rise += limit_of(e)
        if e.side > 0:
            run.least = min(run.least, e.v)
        else:
            run.most = max(run.most, e.v)
    return True


@lean
def _join(runs, ramp, k):
    """Let run k and its siblings fall asleep as one run if all of them sleep in this block, and so on upwards."""
    p = runs[k].parent
    while p >= 0 and runs[p].whole and runs[p].child + ramp.search.leaf_size - 1 == k:
        parent = runs[p]
        for child in range(parent.child, k + 1):
            if not runs[child].sleeps or runs[child].mark != ramp.search.block:
                return
        _begin_run(parent, ramp, runs[parent.child].v, runs[parent.child].rate)
        for child in range(parent.child, k + 1):
            run = runs[child]
            parent.stretch += run.stretch + parent.rise * run.compliance
            parent.compliance += run.compliance
            parent.rise += run.rise
            least, most = _find_bounds(run, run.v, run.rate)
            parent.least, parent.most = min(parent.least, least), max(parent.most, most)
        k, p = p, parent.parent


@lean
def fall_asleep(contacts, springs, block, runs, ramp, count):
    """Let runs of contacts of a solved block fall asleep."""
    if runs is None or ramp.search.path < ramp.search.shortest:
        return
    j = 0
    while j < count:
        k, step = block[j].run, 1
        if k < 0 and block[j].contact % ramp.search.leaf_size == 0 and j + ramp.search.leaf_size <= count:
            leaf = block[j].contact // ramp.search.leaf_size
            if runs[leaf].whole and _form_leaf(contacts, springs, block, runs[leaf], ramp, j):
                k, step, ramp.search.asleep = leaf, ramp.search.leaf_size, 1
        if k >= 0:
            _join(runs, ramp, k)
        j += step
