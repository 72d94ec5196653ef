"""The kernels of ticks: the sums of their accounts, and their messages as the records of a recording."""

from __future__ import annotations

import numpy as np

from crawler_model.body.drive import NS
from crawler_model.compiled import compiled, entry, inlined, inner
from crawler_model.motion.account import (
    AMBIGUOUS,
    COMPLEMENTARITY,
    DISSIPATION,
    OVERSPENT,
    RESIDUAL,
    UNSOLVED,
    VIOLATION,
    WORK,
)

from ..recording.record_head import HEAD_SEQUENCE, HEAD_TIMES, SIZED

_HEAD_LENGTH = 1
"""In the head of a record: place of its length (u64)."""


@compiled
def sum_accounts(accounts):
    """Sum up the accounts of K ticks; their numbers come to Python in one call, which takes a microsecond.

    Args:
        accounts: shape (K, 15).

    Returns:
        The worst of their certificates, not a number counting as worse than any: energy residual [J], violation [N],
        complementarity [J]; the energy turned over [J]; and the ticks whose translation was not determined, the ramps
        over the budget of work, and the ramps that were not solved.
    """
    residual, violation, complementarity, turnover = 0.0, 0.0, 0.0, 0.0
    ambiguous, overspent, unsolved = 0.0, 0.0, 0.0
    for tick in range(accounts.shape[0]):
        account = accounts[tick]
        residual = _worse(abs(account[RESIDUAL]), residual)
        violation = _worse(account[VIOLATION], violation)
        complementarity = _worse(account[COMPLEMENTARITY], complementarity)
        turnover += abs(account[WORK]) + account[DISSIPATION]
        ambiguous += account[AMBIGUOUS] != 0.0
        overspent += account[OVERSPENT]
        unsolved += account[UNSOLVED]
    return residual, violation, complementarity, turnover, ambiguous, overspent, unsolved


@inner
def _worse(value, other):
    return other if value <= other else value


@entry
def encode_ticks(states, ledger, ticks, taken, recorded, output):
    """Encode the commands that each of K ticks followed, and the states at the ends of some of them.

    Args:
        states: the states of one tick, encoded: their bytes; of each message its channel and the place of the head of
            its record, both -1 without one, and the place of its stamp, shape (M, 3); of each sequence of doubles in
            them its place, the place of the doubles of the first tick in `numbers`, their spacing from tick to tick and
            their size, all in bytes, shape (F, 4); and `numbers`, the bytes of the doubles of all ticks that are read.
        ledger: a trajectory of two points, encoded: its bytes, with the head of its record if it has one; its channel
            and the place of that head, or -1, and the places of `TrajectoryMessage`, shape (7,); and whether there is a
            ledger.
        ticks: simulated time at the start of the first tick and at the end of each, shape (K + 1,) [ns]; whether each
            is read, and whether its states are sent, shape (K,).
        taken: as in `Vertices`: times [ns], bytes of rows, and the first vertex of each tick.
        recorded: the time of the last tick's records, the time that all took [ns, wall], and the number of the next
            message on each channel, which is counted on.
        output: output: the bytes of all messages; and of each tick the places of its ledger and of its states in them,
            and where the latter end, shape (K, 3).
    """
    data, messages, fields, numbers = states
    times_ns, read, sent = ticks
    now_ns, took_ns, next_numbers = recorded
    out, bounds = output
    count = sent.size
    place = row = 0
    for tick in range(count):
        recorded_ns = now_ns - took_ns * (count - 1 - tick) // count
        bounds[tick, 0] = place
        if ledger[2]:
            before_ns = recorded_ns - 1  # readers sort by time, and by topic where times are equal
            place = _encode_ledger(ledger, taken, tick, times_ns[tick], next_numbers, before_ns, out, place)
        bounds[tick, 1] = place
        if sent[tick]:
            _copy(out, place, data, 0, data.size)
            for m in range(messages.shape[0]):
                _put_time(out, place + messages[m, 2], times_ns[tick + 1])
                if messages[m, 0] >= 0:
                    _put_head(out, place + messages[m, 1], next_numbers, messages[m, 0], recorded_ns)
            for f in range(fields.shape[0]):
                _copy(out, place + fields[f, 0], numbers, fields[f, 1] + row * fields[f, 2], fields[f, 3])
            place += data.size
        bounds[tick, 2] = place
        row += read[tick]


@inlined
def _encode_ledger(ledger, taken, tick, begin_ns, next_numbers, recorded_ns, out, place):
    """Encode the commands of a tick; return where they end."""
    data, places, _ = ledger
    due_ns, rows, first = taken
    channel, head, stamp, count, first_point, spacing, time = places
    points, end = first[tick + 1] - first[tick], place + count + 4
    _copy(out, place, data, 0, count + 4 if points == 0 else first_point)
    _put(out, place + count, 4, points)
    _put_time(out, place + stamp, begin_ns)
    for point in range(points):
        vertex, begin = first[tick] + point, place + first_point + point * spacing
        end = begin + spacing - 4  # without the number of the next point's positions
        _copy(out, begin, data, first_point, spacing - 4 if point == points - 1 else spacing)
        _copy(out, begin, rows[vertex], 0, rows.shape[1])
        _put_time(out, begin + time, max(due_ns[vertex] - begin_ns, 0))
    if channel >= 0:
        _put(out, place + head + _HEAD_LENGTH, 8, end - place - head - SIZED)
        _put_head(out, place + head, next_numbers, channel, recorded_ns)
    return end


@inlined
def _put_head(out, place, next_numbers, channel, recorded_ns):
    """Write the number of a message on its channel and its two times into the head of its record."""
    _put(out, place + HEAD_SEQUENCE, 4, next_numbers[channel])
    next_numbers[channel] += 1
    _put(out, place + HEAD_TIMES, 8, recorded_ns)
    _put(out, place + HEAD_TIMES + 8, 8, recorded_ns)


@inlined
def _put_time(out, place, ns):
    """Write a time as seconds and nanoseconds."""
    _put(out, place, 4, ns // NS)
    _put(out, place + 4, 4, ns % NS)


@inlined
def _put(out, place, size, value):
    """Write an integer of 4 or 8 bytes."""
    if size == 4:
        out[place : place + 4].view(np.uint32)[0] = value
    else:
        out[place : place + 8].view(np.uint64)[0] = value


@inlined
def _copy(out, place, data, begin, size):
    """Copy bytes, eight at a time because loops of kernels are not vectorized."""
    words = size // 8
    target = out[place : place + 8 * words].view(np.uint64)
    source = data[begin : begin + 8 * words].view(np.uint64)
    for i in range(words):
        target[i] = source[i]
    for i in range(8 * words, size):
        out[place + i] = data[begin + i]
