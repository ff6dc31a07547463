"""Kernels of matrix products, written for LLVM in vectors of as many numbers as the processor takes at once.

Numba compiles them into the functions of `stlbench_agents.products`, which say what they compute.
"""

from __future__ import annotations

from typing import Any

import llvmlite.binding
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

_HOST = llvmlite.binding.get_host_cpu_features()
BYTES = 64 if _HOST.get("avx512f") else 32 if _HOST.get("avx") else 16
"""Of a vector."""
TALL = 4 if BYTES == 32 else 8
"""Rows of a block. With two vectors a row, a block is what the registers hold."""
SUMS = 64
"""Bytes of partial sums of an inner product, the same on all machines, for the same bits."""
_INDEX = ir.IntType(64)


class Kernel:
    """What the functions below have in common: LLVM's types for one kind of number, and loads and stores of vectors."""

    def __init__(
        self, context: Any, builder: ir.IRBuilder, number: types.Float, size: int, columns: ir.Value | None = None
    ) -> None:
        """Args: `size` of a vector in bytes; `columns`, where given, the numbers of it that are there in memory."""
        self.builder, self.context = builder, context
        self.bytes = number.bitwidth // 8
        self.lanes = size // self.bytes
        self.number: ir.Type = context.get_value_type(number)
        self.vector = ir.VectorType(self.number, self.lanes)
        name = f"llvm.fmuladd.v{self.lanes}f{number.bitwidth}"
        kind = ir.FunctionType(self.vector, [self.vector] * 3)
        self._fused = cgutils.get_or_insert_function(builder.module, kind, name)
        self._there = None if columns is None else self._first(columns)

    def place(self, array: Any, kind: types.Array, entry: ir.Value) -> ir.Value:
        """Where an entry of an array is, in bytes."""
        data = self.context.make_array(kind)(self.context, self.builder, array).data
        return self.moved(self.builder.bitcast(data, ir.IntType(8).as_pointer()), self.in_bytes(entry))

    def in_bytes(self, entries: ir.Value) -> ir.Value:
        return self.builder.mul(entries, _INDEX(self.bytes))

    def moved(self, place: ir.Value, distance: ir.Value) -> ir.Value:
        return self.builder.gep(place, [distance])

    def _first(self, columns: ir.Value) -> ir.Value:
        """Which numbers of a vector are the first so many."""
        kind = ir.VectorType(_INDEX, self.lanes)
        undefined, everywhere = (
            ir.Constant(kind, ir.Undefined),
            ir.Constant(ir.VectorType(ir.IntType(32), self.lanes), [0] * self.lanes),
        )
        count = self.builder.insert_element(undefined, columns, ir.IntType(32)(0))
        count = self.builder.shuffle_vector(count, undefined, everywhere)
        return self.builder.icmp_signed("<", ir.Constant(kind, list(range(self.lanes))), count)

    def load(self, place: ir.Value, kind: ir.Type) -> ir.Value:
        if self._there is not None and kind is self.vector:
            return self._masked("load", self.vector, [place, self._there, self.zero])
        loaded = self.builder.load(self.builder.bitcast(place, kind.as_pointer()))
        loaded.align = self.bytes
        return loaded

    def store(self, vector: ir.Value, place: ir.Value) -> None:
        if self._there is not None:
            self._masked("store", ir.VoidType(), [vector, place, self._there])
            return
        self.builder.store(vector, self.builder.bitcast(place, self.vector.as_pointer())).align = self.bytes

    def _masked(self, what: str, result: ir.Type, args: list[ir.Value]) -> ir.Value:
        """Load or store the numbers that are there."""
        place = 1 + (what == "store")
        args = [*args[:place], ir.IntType(32)(self.bytes), *args[place:]]
        kind = ir.FunctionType(result, [arg.type for arg in args])
        name = f"llvm.masked.{what}.v{self.lanes}f{8 * self.bytes}.p0"
        return self.builder.call(cgutils.get_or_insert_function(self.builder.module, kind, name), args)

    def spread(self, number: ir.Value) -> ir.Value:
        """A vector of nothing but this number."""
        undefined, first = ir.Constant(self.vector, ir.Undefined), ir.IntType(32)(0)
        everywhere = ir.Constant(ir.VectorType(ir.IntType(32), self.lanes), [0] * self.lanes)
        return self.builder.shuffle_vector(self.builder.insert_element(undefined, number, first), undefined, everywhere)

    def fused(self, a: ir.Value, b: ir.Value, c: ir.Value) -> ir.Value:
        """a b + c; rounded twice where not all numbers are there."""
        if self._there is not None:
            return self.builder.fadd(c, self.builder.fmul(a, b))
        return self.builder.call(self._fused, [a, b, c])

    @property
    def zero(self) -> ir.Value:
        return ir.Constant(self.vector, [0.0] * self.lanes)


def block_of(tall: int, vectors: int, narrow: bool = False) -> Any:
    """A function that computes the block of results of so many rows, and vectors of columns, at (i, j).

    With `narrow` there are fewer columns than a vector has numbers.
    """

    @intrinsic
    def block(_: Any, a: Any, b: Any, bias: Any, least: Any, out: Any, i: Any, j: Any) -> Any:
        signature = types.void(a, b, bias, least, out, types.intp, types.intp)

        def generate(context: Any, builder: ir.IRBuilder, signature: Any, args: Any) -> Any:
            builder.function.attributes.add("noinline")  # of `product`: copies would only take time to compile
            kinds = [kind.types[0] for kind in (a, b, bias, out)]
            parts = [cgutils.unpack_tuple(builder, args[place]) for place in (0, 1, 2, 4)]
            kernel = Kernel(context, builder, kinds[0].dtype, BYTES, parts[3][3] if narrow else None)
            (a_values, a_at, _, inner, a_row, a_step), (b_values, b_at, *_, b_row, _) = parts[:2]
            (bias_values, bias_at, bias_rows, *_), (out_values, out_at, *_, out_row, _) = parts[2:]
            i, j = args[5:]
            at = builder.add(a_at, builder.mul(i, a_row))
            tops = [
                kernel.place(a_values, kinds[0], builder.add(at, builder.mul(_INDEX(r), a_row))) for r in range(tall)
            ]
            start = _started(kernel, (bias_values, kinds[2], builder.add(bias_at, j)), bias_rows, vectors)
            left = kernel.place(b_values, kinds[1], builder.add(b_at, j))
            moves = kernel.in_bytes(a_step), kernel.in_bytes(b_row)
            sums = _summed(kernel, tops, left, moves, inner, [start] * tall)
            floor = kernel.spread(builder.fptrunc(args[3], kernel.number) if kernel.bytes == 4 else args[3])
            at = builder.add(builder.add(out_at, j), builder.mul(i, out_row))
            for r, row in enumerate(sums):
                place = kernel.place(out_values, kinds[3], builder.add(at, builder.mul(_INDEX(r), out_row)))
                for v, total in enumerate(row):
                    above = builder.select(builder.fcmp_ordered(">", total, floor), total, floor)
                    kernel.store(above, kernel.moved(place, _INDEX(v * BYTES)))
            return context.get_dummy_value()

        return signature, generate

    return block


def _started(kernel: Kernel, bias: tuple[Any, Any, Any], rows: ir.Value, vectors: int) -> list[ir.Value]:
    """What the sums of a row begin with: the bias, or 0 where it has no rows."""
    builder = kernel.builder
    nothing = cgutils.alloca_once_value(builder, kernel.zero)
    place = kernel.place(*bias)
    none = builder.icmp_signed("==", rows, _INDEX(0))
    empty = builder.bitcast(nothing, ir.IntType(8).as_pointer())
    return [
        kernel.load(builder.select(none, empty, kernel.moved(place, _INDEX(v * BYTES))), kernel.vector)
        for v in range(vectors)
    ]


def _summed(
    kernel: Kernel,
    tops: list[ir.Value],
    left: ir.Value,
    moves: tuple[ir.Value, ir.Value],
    inner: ir.Value,
    start: list[list[ir.Value]],
) -> list[list[ir.Value]]:
    """The loop over `inner` terms: to every sum adds an entry of its row of a, times a vector of a row of b."""
    builder = kernel.builder
    before, loop, after = builder.block, builder.append_basic_block("terms"), builder.append_basic_block("summed")
    builder.branch(loop)
    builder.position_at_end(loop)

    def variable(kind: ir.Type, first: ir.Value) -> Any:
        phi = builder.phi(kind)
        phi.add_incoming(first, before)
        return phi

    pointer = ir.IntType(8).as_pointer()
    term, below = variable(_INDEX, _INDEX(0)), variable(pointer, left)
    heads = [variable(pointer, top) for top in tops]
    sums = [[variable(kernel.vector, first) for first in row] for row in start]
    vectors = [kernel.load(kernel.moved(below, _INDEX(v * BYTES)), kernel.vector) for v in range(len(start[0]))]
    added = []
    for head, row in zip(heads, sums, strict=True):
        factor = kernel.spread(kernel.load(head, kernel.number))
        added.append([kernel.fused(factor, vector, total) for vector, total in zip(vectors, row, strict=True)])
    following = builder.add(term, _INDEX(1))
    term.add_incoming(following, loop)
    below.add_incoming(kernel.moved(below, moves[1]), loop)
    for head in heads:
        head.add_incoming(kernel.moved(head, moves[0]), loop)
    for row, now in zip(sums, added, strict=True):
        for total, value in zip(row, now, strict=True):
            total.add_incoming(value, loop)
    builder.cbranch(builder.icmp_signed("<", following, inner), loop, after)
    builder.position_at_end(after)
    return added


@intrinsic
def partial_sums(_: Any, a: Any, a_at: Any, b: Any, b_at: Any, count: Any) -> Any:
    """The inner product of `count` entries, a multiple of the partial sums."""

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, args: Any) -> Any:
        kernel = Kernel(context, builder, a.dtype, SUMS)
        total = cgutils.alloca_once_value(builder, kernel.zero)
        left, right = kernel.place(args[0], a, args[1]), kernel.place(args[2], b, args[3])
        with cgutils.for_range_slice(builder, _INDEX(0), args[4], _INDEX(kernel.lanes), intp=_INDEX) as (entry, _):
            offset = kernel.in_bytes(entry)
            one, other = (kernel.load(kernel.moved(place, offset), kernel.vector) for place in (left, right))
            builder.store(kernel.fused(one, other, builder.load(total)), total)
        return _sum_of(kernel, builder.load(total))

    return a.dtype(a, types.intp, b, types.intp, types.intp), generate


@intrinsic
def row_sums(_: Any, a: Any, a_at: Any, row: Any, b: Any, b_at: Any, count: Any, into: Any, there: Any) -> Any:
    """The inner products of as many rows of a, `row` apart, as there are partial sums, each with the same `count` of b.

    They are written to `into` from `there` on, and have the bits of `partial_sums`: half is added to half here too, but
    for several rows at once.
    """

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, args: Any) -> Any:
        kernel = Kernel(context, builder, a.dtype, SUMS)
        lanes = range(kernel.lanes)
        starts = [kernel.place(args[0], a, builder.add(args[1], builder.mul(_INDEX(i), args[2]))) for i in lanes]
        other = kernel.place(args[3], b, args[4])
        totals = [cgutils.alloca_once_value(builder, kernel.zero) for _ in lanes]
        with cgutils.for_range_slice(builder, _INDEX(0), args[5], _INDEX(kernel.lanes), intp=_INDEX) as (entry, _):
            offset = kernel.in_bytes(entry)
            factor = kernel.load(kernel.moved(other, offset), kernel.vector)
            for start, total in zip(starts, totals, strict=True):
                values = kernel.load(kernel.moved(start, offset), kernel.vector)
                builder.store(kernel.fused(values, factor, builder.load(total)), total)
        rows = [builder.load(total) for total in totals]
        while len(rows) > 1:
            half = len(rows) // 2
            pairs = (_exchanged(kernel, rows[i], rows[i + half], half) for i in range(half))
            rows = [builder.fadd(first, second) for first, second in pairs]
        kernel.store(rows[0], kernel.place(args[6], into, args[7]))
        return context.get_dummy_value()

    integers = types.intp, types.intp
    return types.void(a, *integers, b, *integers, into, types.intp), generate


def _sum_of(kernel: Kernel, vector: ir.Value) -> ir.Value:
    """The sum of a vector's numbers, half to half."""
    builder, count = kernel.builder, kernel.lanes
    while count > 1:
        count //= 2
        order = [lane + count if lane < count else 0 for lane in range(kernel.lanes)]
        mask = ir.Constant(ir.VectorType(ir.IntType(32), kernel.lanes), order)
        vector = builder.fadd(vector, builder.shuffle_vector(vector, vector, mask))
    return builder.extract_element(vector, ir.IntType(32)(0))


@intrinsic
def turned_block(_: Any, a: Any, at: Any, row: Any, into: Any, there: Any, width: Any) -> Any:
    """Transpose the square block at an offset, with as many rows as a vector has numbers, its rows `row` apart.

    It is written to `into` from the offset `there` on, its rows `width` apart.
    """

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, args: Any) -> Any:
        kernel = Kernel(context, builder, a.dtype, BYTES)
        rows = [
            kernel.load(kernel.place(args[0], a, builder.add(args[1], builder.mul(_INDEX(i), args[2]))), kernel.vector)
            for i in range(kernel.lanes)
        ]
        distance = kernel.lanes
        while distance > 1:  # exchange the off-diagonal quarters of ever smaller squares
            distance //= 2
            for i in range(kernel.lanes):
                if not i & distance:
                    rows[i], rows[i + distance] = _exchanged(kernel, rows[i], rows[i + distance], distance)
        for i, line in enumerate(rows):
            kernel.store(line, kernel.place(args[3], into, builder.add(args[4], builder.mul(_INDEX(i), args[5]))))
        return context.get_dummy_value()

    return types.void(a, types.intp, types.intp, into, types.intp, types.intp), generate


def _exchanged(kernel: Kernel, upper: ir.Value, lower: ir.Value, distance: int) -> tuple[ir.Value, ir.Value]:
    """Two rows of a square, the upper's right parts exchanged with the lower's left parts."""
    lanes, kind = range(kernel.lanes), ir.VectorType(ir.IntType(32), kernel.lanes)
    left = [kernel.lanes + lane - distance if lane & distance else lane for lane in lanes]
    right = [kernel.lanes + lane if lane & distance else lane + distance for lane in lanes]
    first, second = (kernel.builder.shuffle_vector(upper, lower, ir.Constant(kind, order)) for order in (left, right))
    return first, second
