import threading

from crawler_ros.node.life.fair_lock import FairLock

from ...processes import wait_until


def test_a_thread_that_waits_comes_before_the_one_that_releases():
    """A loop that releases its lock and takes it again at once must not keep services waiting."""
    lock, order = FairLock(), []

    def serve():
        with lock:
            order.append("service")

    for _ in range(100):
        order.clear()
        lock.acquire()
        server = threading.Thread(target=serve)
        server.start()
        wait_until(lock._next.locked, what="a thread that waits")
        lock.release()
        with lock:
            order.append("loop")
        server.join()
        assert order == ["service", "loop"]


def test_it_is_not_taken_without_waiting_while_another_thread_has_it_or_waits():
    lock, done = FairLock(), threading.Event()
    lock.acquire()
    server = threading.Thread(target=lambda: (lock.acquire(), done.wait(), lock.release()))
    server.start()
    wait_until(lock._next.locked, what="a thread that waits")
    assert not lock.acquire(blocking=False)
    lock.release()
    wait_until(lambda: not lock._next.locked(), what="a thread that has it")
    assert not lock.acquire(blocking=False)
    done.set()
    server.join()
    assert lock.acquire(blocking=False)
