"""Work on many robots, shared by threads that stay awake between one step and the next.

A step of a batch of mazes takes a tenth of a millisecond; to wake a sleeping thread takes as long.
So helpers wait for work in compiled code without the interpreter's lock, for about as long as a
step, and sleep only when nothing has come. Work is a number of *shares*; whoever is free takes the
next one, the caller among them, so a helper that is late costs nothing: its shares are done by
others. What a share is does not depend on who does it, nor on how many there are: results are the
same bits for any number of threads.

Every thread has a queue of shares that it takes from first, the same ones each time: what it wrote
for them in the last step is in its own cache still. Then it takes what others have not come to.

The shared state is one array of int64 (:func:`new_board`), read and written atomically.
"""

from __future__ import annotations

import os
import platform
import threading
import weakref
from collections.abc import Callable, Iterable
from concurrent.futures import Executor, ThreadPoolExecutor, wait
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array
from numpy.typing import NDArray

# Places on the board, each in a cache line of its own.
LINE = 8
LIMIT, DONE, CLOSED, THREADS = (LINE * i for i in range(4))
OF_A_THREAD = 2 * LINE
NEXT, ASLEEP = 0, LINE
PATIENCE = 20_000
"""Times a helper looks for work before it sleeps: about half a millisecond."""

POLITE = 32
"""Times between looks at which it gives way, in case that it waits for one on its own core."""


# To the type checkers what it makes of a function is no function of the same arguments.
_in_line: Any = intrinsic
building: Any = cgutils
pointer: Any = types.CPointer


def _pointer(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    made: Any = make_array
    array = made(signature.args[0])(context, builder, args[0])
    return building.gep_inbounds(builder, array.data, args[1])


@_in_line
def load(typing_context: Any, board: Any, at: Any) -> Any:
    """What stands on the board."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load_atomic(_pointer(context, builder, signature, args), "seq_cst", 8)

    return types.int64(board, types.intp), code


@_in_line
def add(typing_context: Any, board: Any, at: Any, value: Any) -> Any:
    """Add to what stands on the board; returns what stood there."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        place = _pointer(context, builder, signature, args)
        return builder.atomic_rmw("add", place, args[2], "seq_cst")

    return types.int64(board, types.intp, types.int64), code


@_in_line
def replace_if(typing_context: Any, board: Any, at: Any, old: Any, new: Any) -> Any:
    """Replace what stands on the board if it is ``old``; whether it was."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        place = _pointer(context, builder, signature, args)
        both = builder.cmpxchg(place, args[2], args[3], "seq_cst", "seq_cst")
        return builder.extract_value(both, 1)

    return types.boolean(board, types.intp, types.int64, types.int64), code


@_in_line
def pause(typing_context: Any) -> Any:
    """Let a moment pass, as processors like it in a loop that waits."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        if platform.machine().lower() in ("x86_64", "amd64"):
            kind = ir.FunctionType(ir.VoidType(), [])
            builder.call(builder.module.declare_intrinsic("llvm.x86.sse2.pause", (), kind), [])
        return context.get_dummy_value()

    return types.none(), code


@_in_line
def floats_at(typing_context: Any, address: Any) -> Any:
    """A pointer to the numbers of 32 bits at an address: those of an array that is kept alive."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

    return pointer(types.float32)(types.int64), code


@_in_line
def give_way(typing_context: Any) -> Any:
    """Let another thread run that waits for this core; on Windows, nothing."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        if os.name == "posix":
            kind = ir.FunctionType(ir.IntType(32), [])
            builder.call(building.get_or_insert_function(builder.module, kind, "sched_yield"), [])
        return context.get_dummy_value()

    return types.none(), code


def new_board(n_helpers: int) -> NDArray[np.int64]:
    """A board with nothing to do."""
    return np.zeros(THREADS + OF_A_THREAD * (n_helpers + 1), dtype=np.int64)


@njit(cache=True, nogil=True)
def place_of(thread: int, what: int) -> int:
    """Where ``NEXT`` or ``ASLEEP`` of a thread stands; the caller is thread 0."""
    return THREADS + OF_A_THREAD * thread + what


@njit(cache=True, nogil=True)
def n_threads(board: NDArray[np.int64]) -> int:
    """The caller and its helpers."""
    return (board.shape[0] - THREADS) // OF_A_THREAD


@njit(cache=True, nogil=True)
def take(board: NDArray[np.int64], thread: int, n_each: int) -> int:
    """A share that nobody has, of those published last; -1 if there is none.

    Args:
        board: .
        thread: Who asks.
        n_each: Shares in a thread's queue; the first queue's shares are numbered first.
    """
    n = n_threads(board)
    for step in range(n):
        queue = (thread + step) % n
        place = place_of(queue, NEXT)
        while True:
            share = load(board, place)
            if share >= load(board, LIMIT):
                break
            if replace_if(board, place, share, share + 1):
                return queue * n_each + share % n_each
    return -1


@njit(cache=True, nogil=True)
def finish(board: NDArray[np.int64]) -> None:
    """A share that was taken has been done."""
    add(board, DONE, 1)


@njit(cache=True, nogil=True)
def publish(board: NDArray[np.int64], n_each: int) -> None:
    """There is work: ``n_each`` more shares for every thread. What they need is written before."""
    add(board, LIMIT, n_each)


@njit(cache=True, nogil=True)
def wait_for_others(board: NDArray[np.int64]) -> None:
    """Until every share that was published has been done."""
    looks = 0
    while load(board, DONE) < n_threads(board) * load(board, LIMIT):
        looks += 1
        if looks % POLITE == 0:
            give_way()
        pause()


@njit(cache=True, nogil=True)
def is_worth_waiting(board: NDArray[np.int64], helper: int, idle: int) -> bool:
    """Whether a helper without work should look again; if not, it is noted as asleep."""
    if idle < PATIENCE and load(board, CLOSED) == 0:
        if idle % POLITE == 0:
            give_way()
        pause()
        return True
    add(board, place_of(helper, ASLEEP), 1)
    return False


class Helpers:
    """Threads beside the caller's own, made when they are first needed in a process.

    A process that is forked from another has no threads but the one that forked: it makes its own,
    with a board of its own.

    Args:
        n: How many.
        work: ``work(board, helper)``: takes shares until :func:`is_worth_waiting` says no. Helpers
            are numbered from 1.
    """

    def __init__(self, n: int, work: Callable[[NDArray[np.int64], int], None]) -> None:
        self.n = n
        self._work = work
        self._pid = -1
        self._doors: list[tuple[int, Any]] = []
        self._close: Any = None
        self.board = new_board(n)

    def __getstate__(self) -> dict[str, Any]:
        """Threads are not copied: a copy makes its own."""
        kept = {"n": self.n, "_work": self._work, "_pid": -1, "_doors": [], "_close": None}
        return {**kept, "board": new_board(self.n)}

    def call(self) -> NDArray[np.int64]:
        """See that the helpers are awake, or soon will be; returns the board."""
        if self._pid != os.getpid():
            self._start()
        board = self.board
        for at, door in self._doors:
            if board[at]:
                board[at] = 0
                door.release()
        return board

    def _start(self) -> None:
        self._pid = os.getpid()
        # Compiled here: a process that ends while a thread compiles is aborted.
        closed = new_board(self.n)
        closed[CLOSED] = 1
        self._work(closed, 1)
        self.board = new_board(self.n)
        self._doors = []
        for helper in range(1, self.n + 1):
            at, door = place_of(helper, ASLEEP), threading.Lock()
            door.acquire()
            self.board[at] = 1
            self._doors.append((at, door))
            threading.Thread(
                target=_serve, args=(self._work, self.board, helper, door), daemon=True,
                name=f"activeloc-helper-{helper}",
            ).start()  # fmt: skip
        self._close = weakref.finalize(self, _close, self.board, self._doors, self._pid)

    def close(self) -> None:
        """Let the threads end; they are made anew if there is work again."""
        if self._close is not None:
            self._close()
        self._pid, self._doors, self._close = -1, [], None


def _serve(
    work: Callable[[NDArray[np.int64], int], None],
    board: NDArray[np.int64],
    helper: int,
    door: threading.Lock,
) -> None:
    """What a helper's thread runs."""
    while True:
        door.acquire()
        if board[CLOSED]:
            return
        work(board, helper)


def _close(board: NDArray[np.int64], doors: list[tuple[int, Any]], pid: int) -> None:
    if pid != os.getpid():
        return
    board[CLOSED] = 1
    for at, door in doors:
        # Whoever is awake sees the board before it sleeps, and finds its door open then.
        if door.locked():
            board[at] = 0
            door.release()


class Pool:
    """Threads that take robots of a batch, one after another, and do in Python what is to be done.

    For steps of a millisecond a robot, most of it in compiled code. Made when first needed, in
    every process that needs it, as :class:`Helpers` are.

    Args:
        threads: With the caller's own.
    """

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._pid = -1
        self._executor: Executor | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Threads are not copied: a copy makes its own."""
        return {"threads": self.threads, "_pid": -1, "_executor": None}

    def each(self, task: Callable[[int], object], robots: Iterable[int]) -> None:
        """Do a task for each robot; robots are independent of each other.

        What a task raises is raised here, once nobody works any more.
        """
        todo = list(robots)
        n, robot_after_robot = min(self.threads, len(todo)) - 1, iter(todo)

        def take() -> None:
            for robot in robot_after_robot:
                task(robot)

        if n < 1:
            take()
            return
        others = [self._workers().submit(take) for _ in range(n)]
        try:
            take()
        finally:
            wait(others)
        for other in others:
            other.result()

    def _workers(self) -> Executor:
        if self._executor is None or self._pid != os.getpid():
            self._executor = ThreadPoolExecutor(self.threads - 1, "activeloc-helper")
            self._pid = os.getpid()
        return self._executor

    def close(self) -> None:
        """Let the threads end; they are made anew if there is work again."""
        if self._executor is not None and self._pid == os.getpid():
            self._executor.shutdown(wait=False)
        self._executor = None
