"""Long sliding paths, whose contacts sleep: clusters that a block treats like one spring and contact.

Through a cluster of sliding contacts, velocity and rate of tension change like through one spring with a contact
behind it:

    v_behind = v_before + stretch + compliance rate,    rate_behind = rate + rise,

with `stretch` the velocity that its springs add if the rate before it is zero, and `rise` the sum of the rates of the
forces of its contacts. Such maps are composed, so clusters form a tree: contacts make leaves, and as many sleeping
clusters side by side, `ramp.search.leaf_size`, make a larger one. A block of n contacts then has some log n rows.

A sleeping cluster integrates over s its velocity and its rate, and s times each of them; displacements, tensions and
work follow when it wakes. It wakes when one of its contacts may turn round: v_i differs from what it was when last
looked at by the change of v_before and by the change of the rate, times at most the compliance of the cluster.
"""

from __future__ import annotations

import numpy as np

from ...compiled import inlined, lean
from .advance import move
from .path import elongation_rate, limit_of
from .records import BACKWARD, FORWARD


@lean
def _advance_cluster(cluster, s):
    """Integrate velocity and rate of a sleeping cluster up to s."""
    ds = s - cluster.since
    if ds > 0.0:
        middle = 0.5 * (s + cluster.since)
        cluster.time += ds
        cluster.way += cluster.v * ds
        cluster.pull += cluster.rate * ds
        cluster.time_moment += middle * ds
        cluster.way_moment += middle * cluster.v * ds
        cluster.pull_moment += middle * cluster.rate * ds
    cluster.since = s


@lean
def _begin_cluster(cluster, ramp, v, rate):
    """Let a cluster fall asleep at s."""
    cluster.sleeps, cluster.mark, cluster.since = 1, ramp.search.block, ramp.s
    cluster.v, cluster.rate = v, rate
    cluster.seen_v, cluster.seen_rate = v, rate
    cluster.time = cluster.way = cluster.pull = cluster.time_moment = cluster.way_moment = cluster.pull_moment = 0.0
    cluster.stretch = cluster.compliance = cluster.rise = 0.0
    cluster.least, cluster.most = np.inf, -np.inf


@lean
def _find_bounds(cluster, v, rate):
    """Bound the velocities of the contacts of a cluster: from below where they slide forward, else from above."""
    change = v - cluster.seen_v
    other = change + (rate - cluster.seen_rate) * cluster.compliance
    return cluster.least + min(change, other), cluster.most + max(change, other)


@lean
def _wake_children(clusters, cluster, ramp):
    """Hand what a cluster of clusters has integrated to its children."""
    stretch = compliance = rise = 0.0
    for k in range(cluster.child, cluster.child + ramp.search.leaf_size):
        child = clusters[k]
        child.v, child.rate, child.since = (
            cluster.v + (stretch + compliance * cluster.rate),
            cluster.rate + rise,
            cluster.since,
        )
        child.time += cluster.time
        child.way += cluster.way + stretch * cluster.time + compliance * cluster.pull
        child.pull += cluster.pull + rise * cluster.time
        child.time_moment += cluster.time_moment
        child.way_moment += cluster.way_moment + stretch * cluster.time_moment + compliance * cluster.pull_moment
        child.pull_moment += cluster.pull_moment + rise * cluster.time_moment
        stretch += child.stretch + rise * child.compliance
        compliance += child.compliance
        rise += child.rise


@lean
def _wake_contacts(contacts, springs, cluster, ramp):
    """Move the contacts and springs of a leaf, and account for their way; they slide on with the present velocities."""
    stretch = compliance = rise = 0.0
    for i in range(cluster.first, cluster.last + 1):
        spring, c = springs[cluster.spring + i - cluster.first], contacts[i]
        pull = cluster.pull + rise * cluster.time
        moment = cluster.pull_moment + rise * cluster.time_moment
        # the integral of T over s is s T at its end less s T at its beginning less the integral of s times the rate
        before, after = spring.tension, spring.tension + pull
        ramp.account.work -= spring.d_length * ((cluster.since * after - spring.since * before) - moment)
        spring.tension, spring.rate, spring.since, spring.moved = after, cluster.rate + rise, cluster.since, 1
        stretch += spring.d_length + rise * spring.compliance
        compliance += spring.compliance
        way = cluster.way + stretch * cluster.time + compliance * cluster.pull
        moment = cluster.way_moment + stretch * cluster.time_moment + compliance * cluster.pull_moment
        c.v = cluster.v + (stretch + compliance * cluster.rate)
        if c.bounds_met & FORWARD:
            ramp.account.dissipation += c.forward * way + c.d_forward * moment
        else:
            ramp.account.dissipation -= c.backward * way + c.d_backward * moment
        ramp.account.loads_work += c.load * way + c.d_load * moment
        move(c, way)
        c.force += c.force_rate * (cluster.since - c.since)
        c.since = cluster.since
        rise += c.force_rate


@lean
def _wake(contacts, springs, clusters, ramp, k):
    """Wake cluster k: its children sleep on, or its contacts are known where it was last advanced to."""
    cluster = clusters[k]
    cluster.sleeps = 0
    if cluster.child >= 0:
        _wake_children(clusters, cluster, ramp)
    else:
        _wake_contacts(contacts, springs, cluster, ramp)


@lean
def wake_all(contacts, springs, clusters, ramp):
    """Wake all clusters: their contacts are moved, and their account is added to the ramp's.

    Returns:
        Whether any were asleep; blocks found before must then be found anew.
    """
    if clusters is None:
        return False
    asleep = ramp.search.asleep != 0
    if asleep:
        ramp.search.asleep = 0
        for k in range(clusters.shape[0] - 1, -1, -1):  # parents before their children
            if clusters[k].sleeps:
                _wake(contacts, springs, clusters, ramp, k)
    return asleep


@inlined
def find_cluster(clusters, ramp, i):
    """Find the largest sleeping cluster of a contact.

    Returns:
        Its index; -1 if the contact is awake.
    """
    if clusters is None or not ramp.search.asleep:
        return -1
    k = i // ramp.search.leaf_size
    if not clusters[k].sleeps:
        return -1
    while clusters[k].parent >= 0 and clusters[clusters[k].parent].sleeps:
        k = clusters[k].parent
    return k


@inlined
def find_span(clusters, ramp, i):
    """Find the first and the last contact of the largest sleeping cluster of a contact, and the spring before them.

    Returns:
        The two contacts and the spring; the contact itself twice and -1 if it is awake.
    """
    if clusters is None:
        return i, i, -1
    k = find_cluster(clusters, ramp, i)
    return (clusters[k].first, clusters[k].last, clusters[k].spring) if k >= 0 else (i, i, -1)


@inlined
def enter_cluster(contacts, clusters, e, k):
    """Enter a cluster in a row of the block, as an equivalent spring and contact.

    Args:
        e: the BLOCK.
        k: index of the cluster.
    """
    if clusters is None:
        return
    cluster = clusters[k]
    e.cluster, e.contact = k, cluster.last
    e.side = 1 if contacts[cluster.last].bounds_met & FORWARD else -1
    e.upper = e.lower = cluster.rise
    e.blur = 0.0
    e.spring, e.sign = cluster.spring, 1.0
    e.compliance, e.trial = cluster.compliance, -cluster.stretch / cluster.compliance


@inlined
def wake_turning(contacts, springs, block, clusters, ramp, count):
    """Wake the clusters of a solved block in which a contact may turn round.

    Returns:
        Whether there are any; the block must then be found anew.
    """
    if clusters is None:
        return False
    for j in range(count if ramp.search.asleep else 0):
        e = block[j]
        if e.cluster < 0:
            continue
        least, most = _find_bounds(clusters[e.cluster], e.v - elongation_rate(e.flow, e.trial, e.compliance), e.flow)
        if least < 0.0 or most > 0.0:
            _wake(contacts, springs, clusters, ramp, e.cluster)
            ramp.search.woken = 1
    return ramp.search.woken != 0


@inlined
def set_clusters(springs, block, clusters, ramp, count):
    """Give the sleeping clusters of a solved block the velocities and rates that were found."""
    if clusters is None:
        return
    for j in range(count if ramp.search.asleep else 0):
        e = block[j]
        if e.cluster >= 0:
            cluster = clusters[e.cluster]
            _advance_cluster(cluster, ramp.s)
            cluster.v, cluster.rate = e.v - elongation_rate(e.flow, e.trial, e.compliance), e.flow
            cluster.mark = ramp.search.block
            springs[e.spring].rate = e.flow  # for the wall before it


@lean
def _sleeps_soundly(c, e):
    """Determine whether a contact slides with its bound for as long as no event changes its block."""
    return e.cluster < 0 and e.v * e.side > 0.0 and c.side == e.side and c.leaving == 0 and c.next > 1.0


@lean
def _form_leaf(contacts, springs, block, cluster, ramp, j):
    """Let the contacts of rows j .. fall asleep as a leaf if all of them slide; returns whether they do."""
    for t in range(ramp.search.leaf_size):
        e = block[j + t]
        c = contacts[e.contact]
        if e.contact != block[j].contact + t or not _sleeps_soundly(c, e) or c.bounds_met == FORWARD | BACKWARD:
            return False
    e = block[j]
    _begin_cluster(cluster, ramp, e.v - elongation_rate(e.flow, e.trial, e.compliance), e.flow)
    for t in range(ramp.search.leaf_size):
        e = block[j + t]
        spring = springs[e.spring]
        cluster.stretch += spring.d_length + cluster.rise * spring.compliance
        cluster.compliance += spring.compliance
        cluster.rise += limit_of(e)
        if e.side > 0:
            cluster.least = min(cluster.least, e.v)
        else:
            cluster.most = max(cluster.most, e.v)
    return True


@lean
def _join(clusters, ramp, k):
    """Let cluster k and its siblings fall asleep as one if all of them sleep in this block, and so on upwards."""
    p = clusters[k].parent
    while p >= 0 and clusters[p].whole and clusters[p].child + ramp.search.leaf_size - 1 == k:
        parent = clusters[p]
        for child in range(parent.child, k + 1):
            if not clusters[child].sleeps or clusters[child].mark != ramp.search.block:
                return
        _begin_cluster(parent, ramp, clusters[parent.child].v, clusters[parent.child].rate)
        for child in range(parent.child, k + 1):
            cluster = clusters[child]
            parent.stretch += cluster.stretch + parent.rise * cluster.compliance
            parent.compliance += cluster.compliance
            parent.rise += cluster.rise
            least, most = _find_bounds(cluster, cluster.v, cluster.rate)
            parent.least, parent.most = min(parent.least, least), max(parent.most, most)
        k, p = p, parent.parent


@lean
def fall_asleep(contacts, springs, block, clusters, ramp, count):
    """Let clusters of contacts of a solved block fall asleep."""
    if clusters is None or ramp.search.path < ramp.search.shortest:
        return
    j = 0
    while j < count:
        k, step = block[j].cluster, 1
        if k < 0 and block[j].contact % ramp.search.leaf_size == 0 and j + ramp.search.leaf_size <= count:
            leaf = block[j].contact // ramp.search.leaf_size
            if clusters[leaf].whole and _form_leaf(contacts, springs, block, clusters[leaf], ramp, j):
                k, step, ramp.search.asleep = leaf, ramp.search.leaf_size, 1
        if k >= 0:
            _join(clusters, ramp, k)
        j += step
